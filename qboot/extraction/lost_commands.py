"""Commands that the traces give and no extracted action does: what only they can do cannot be learned.

A side of an effector is the half of its range below or above the middle, as the Hamming distance sees it: for the crane
of ball collecting, below lets go of a ball and above holds it. Clustering averages rare commands away.
Shape letters: T timesteps of all traces, E effectors, n linear commands (actions or segments).
"""

from typing import NamedTuple

import numpy as np

from qboot.extraction.actions import ActionSet
from qboot.extraction.segmentation import Segments

MIDDLE = 0.5
SIDES = ("below", "above")
# Commands in fewer of the steps are taken for jitter.
LEAST_SHARE = 1e-4


class Use(NamedTuple):
    """How often commands are on one side of one effector."""

    of_steps: float  # share of the traces' timesteps
    of_actions: int  # number of actions that are there at their first or last step


def is_on(commands: np.ndarray, side: str) -> np.ndarray:
    """Which commands of one effector, in [0, 1] and of any shape, are on a side of it, bool of that shape."""
    return commands < MIDDLE if side == "below" else commands >= MIDDLE


def on_side(linear: ActionSet | Segments, effector: int, side: str) -> np.ndarray:
    """Which linear commands (n,) are on a side of an effector at their first or last step, (n,) bool."""
    first = np.asarray(linear.intercepts)[:, effector]
    last = first + np.asarray(linear.slopes)[:, effector] * (np.asarray(linear.durations) - 1)
    return is_on(first, side) | is_on(last, side)


def uses(commands: np.ndarray, actions: ActionSet, effectors: tuple[str, ...]) -> dict[tuple[str, str], Use]:
    """The use of each (effector, side); commands (T, E) in [0, 1]."""
    return {
        (name, side): Use(float(is_on(commands[:, i], side).mean()), int(on_side(actions, i, side).sum()))
        for i, name in enumerate(effectors)
        for side in SIDES
    }


def lost(commands: np.ndarray, actions: ActionSet, effectors: tuple[str, ...]) -> str:
    """What the traces' commands (T, E) give and no action does, in words; empty if there is nothing."""
    found = uses(commands, actions, effectors)
    return ", ".join(
        f"{name} {side} {MIDDLE:g} ({use.of_steps:.2%} of the steps of the traces)"
        for (name, side), use in found.items()
        if use.of_steps >= LEAST_SHARE and not use.of_actions
    )
