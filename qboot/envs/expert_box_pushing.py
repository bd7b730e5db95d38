"""What an expert would give the arm of box pushing to learn with (section VII)."""

import numpy as np

from qboot.envs import arm, box_pushing
from qboot.extraction.actions import ActionSet
from qboot.extraction.baselines import constant_actions

# Durations of random actions: shortest and longest, in steps.
RANDOM_DURATIONS = (2, 20)

SENSORS = {
    1: box_pushing.SENSORS,
    2: ("hand_x", "hand_y", "hand_z", "hand_x_from_block", "hand_y_from_block"),
}
"""Sensors by lag, 1 is now. They stand for the paper's human-chosen ones, which it does not list: all sensors as they
are now, and where the hand was one decision ago (so that it is known where it is going)."""


def actions(duration: int = 9, distance: float = 0.04) -> ActionSet:
    """Stand still, or move by a fixed distance along one of three axes, either way: seven actions.

    Args:
        duration: of each action, in steps, >= 1.
        distance: of each move, in metres; 4 cm is the width of the window in which a push counts as centred.

    Raises:
        ValueError: if `duration` is less than 1, or too short for the distance at full speed.
    """
    if not 0 < distance <= duration * arm.LONGEST_STEP.min():
        farthest = duration * arm.LONGEST_STEP.min()
        raise ValueError(f"distance must lie above 0 and up to {farthest:.3g} m in {duration} steps, got {distance}.")
    along = np.diag(distance / duration / arm.STEP_PER_COMMAND)
    return constant_actions(0.5 + np.vstack([np.zeros(3), along, -along]), duration)
