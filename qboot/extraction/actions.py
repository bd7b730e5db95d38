"""Discrete actions with linear commands, and their extraction by clustering (paper, sections IV-B and IV-C).

Shape letters: A actions, E effectors, n segments.
"""

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.extraction.clustering import cluster
from qboot.extraction.segmentation import Segments, cut_segments

SCALES = ("none", "std", "minmax", "logstd")
# Centres nearer than this in every feature, in standard deviations of it, count as one.
SAME_CENTRE = 0.02


class ActionSet(NamedTuple):
    """The actions of a Q-learner: linear commands held for a number of steps (equations 4 to 6)."""

    slopes: np.ndarray | jax.Array  # (A, E) float32, per step
    intercepts: np.ndarray | jax.Array  # (A, E) float32
    durations: np.ndarray | jax.Array  # (A,) int32 steps, >= 1


@dataclass(frozen=True)
class ActionSettings:
    """How actions are extracted. Raises `ValueError` when a value lies outside the range given under it."""

    n_actions: int = 17
    """Na: number of actions, >= 1 (17 for ball collecting, 7 for box pushing)."""

    fuzziness: float = 1.3
    """m of fuzzy c-means, > 1. The paper gives none. Nearer to 1, fewer centres coincide."""

    scale: str = "none"
    """Scaling of the features to cluster: "none", "std", "minmax", or "logstd" (log duration, then std). The paper
    gives none."""

    duration_unit: float = 20.0
    """Steps of duration that count as much as the whole range of a command, with the scale "none", > 0. With 1,
    durations alone decide, and rare commands, such as dropping a ball, are averaged away."""

    min_duration: int = 8
    """Segments last at least so many steps, >= 1: split points that follow too soon are passed over. With 1, as
    printed in the paper, a network that jitters gives actions of two or three steps, and exploring with them gets
    nowhere."""

    max_duration: int = 100
    """Segments that last longer, in steps, are cut into equal parts before the clustering, >= 1: an action cannot be
    interrupted, and one of thousands of steps spends a whole test."""

    restarts: int = 1
    """Clusterings from different first centres, >= 1; the one with the smallest sum of distances is kept."""

    max_iterations: int = 300
    """Updates of the centres at most, >= 1."""

    tolerance: float = 1e-4
    """Stop when no centre moves by more than this share of the features' largest standard deviation, >= 0."""

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        if self.n_actions < 1:
            raise ValueError(f"n_actions must be at least 1, got {self.n_actions}.")
        if not self.fuzziness > 1:
            raise ValueError(f"fuzziness must be greater than 1, got {self.fuzziness}.")
        if self.scale not in SCALES:
            raise ValueError(f"scale must be one of {SCALES}, got {self.scale!r}.")
        if not self.duration_unit > 0:
            raise ValueError(f"duration_unit must be positive, got {self.duration_unit}.")
        if not 1 <= self.min_duration <= self.max_duration:
            raise ValueError(
                f"durations must satisfy 1 <= min_duration <= max_duration, got {self.min_duration} and "
                f"{self.max_duration}."
            )
        if self.restarts < 1:
            raise ValueError(f"restarts must be at least 1, got {self.restarts}.")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations must be at least 1, got {self.max_iterations}.")
        if not self.tolerance >= 0:
            raise ValueError(f"tolerance must not be negative, got {self.tolerance}.")


class ActionInfo(NamedTuple):
    """What an extraction of actions is reported by."""

    n_segments: int
    n_distinct: int  # of the centres; fewer than n_actions when some coincide
    durations_before: np.ndarray  # (3,) quartiles over the segments, steps
    durations_after: np.ndarray  # (3,) quartiles over the actions, steps
    iterations: int  # of the clustering


class Scaling(NamedTuple):
    """Feature scaling that can be undone: minus `origin`, over `unit`, the last feature's log if `is_log`."""

    is_log: bool
    origin: np.ndarray  # (2E + 1,)
    unit: np.ndarray  # (2E + 1,), > 0

    def apply(self, features: np.ndarray) -> np.ndarray:
        """Scaled features (n, 2E + 1)."""
        return ((_with_last(features, np.log) if self.is_log else features) - self.origin) / self.unit

    def undo(self, scaled: np.ndarray) -> np.ndarray:
        """Raw features (n, 2E + 1)."""
        features = scaled * self.unit + self.origin
        return _with_last(features, np.exp) if self.is_log else features


def commands(actions: ActionSet, a: jax.Array, t: jax.Array) -> jax.Array:
    """Commands of action `a` at its step `t` (equation 4), clipped to the effectors' range [0, 1].

    Works under jit and vmap. `a` and `t` are () or of equal shape (...); returns (E,) or (..., E).
    """
    time = jnp.asarray(t)[..., None]
    # A traced index cannot pick from a NumPy array.
    slopes, intercepts = jnp.asarray(actions.slopes)[a], jnp.asarray(actions.intercepts)[a]
    return jnp.clip(slopes * time + intercepts, 0.0, 1.0)


def cluster_actions(segments: Segments, settings: ActionSettings, seed: int) -> tuple[ActionSet, ActionInfo]:
    """The most representative actions: centres of fuzzy clusters of (u_1, v_1, ..., u_E, v_E, d).

    All `n_actions` centres are returned, coinciding ones too (with a warning), so that a Q-learner's shape
    does not depend on the data. Durations are rounded to whole steps, at least 1.

    Args:
        segments: n of them.
        settings: number of actions, fuzziness, scaling.
        seed: decides the first centres.

    Raises:
        ValueError: if there are fewer segments than actions.
    """
    features = _features(cut_segments(segments, settings.max_duration))
    if len(features) < settings.n_actions:
        raise ValueError(
            f"{settings.n_actions} actions need at least as many segments, got {len(features)}: "
            "use more or longer traces, or fewer actions."
        )
    scaling = fit_scaling(features, settings.scale, settings.duration_unit)
    found = cluster(
        scaling.apply(features),
        settings.n_actions,
        settings.fuzziness,
        seed,
        max_iterations=settings.max_iterations,
        tolerance=settings.tolerance,
        restarts=settings.restarts,
    )
    actions = _actions(scaling.undo(found.centres))
    standard = fit_scaling(features, "logstd" if settings.scale == "logstd" else "std")
    n_distinct = count_distinct(standard.apply(scaling.undo(found.centres)))
    if n_distinct < settings.n_actions:
        warnings.warn(
            f"only {n_distinct} of the {settings.n_actions} extracted actions are distinct: "
            "a fuzziness nearer to 1 keeps centres apart.",
            stacklevel=2,
        )
    before, after = (np.percentile(source.durations, [25, 50, 75]) for source in (segments, actions))
    return actions, ActionInfo(len(segments.durations), n_distinct, before, after, found.iterations)


def fit_scaling(features: np.ndarray, scale: str, duration_unit: float = 1.0) -> Scaling:
    """The scaling `scale` (one of SCALES) of features (n, 2E + 1); constant features are only shifted."""
    if scale == "none":
        unit = np.append(np.ones(features.shape[1] - 1), duration_unit)
        return Scaling(False, np.zeros(features.shape[1]), unit)
    is_log = scale == "logstd"
    if is_log:
        features = _with_last(features, np.log)
    if scale == "minmax":
        origin, unit = features.min(axis=0), np.ptp(features, axis=0)
    else:
        origin, unit = features.mean(axis=0), features.std(axis=0)
    # Rounding leaves a constant feature with a tiny spread that must not be blown up.
    is_constant = unit <= 1e-9 * np.maximum(np.abs(origin), 1)
    return Scaling(is_log, origin, np.where(is_constant, 1.0, unit))


def count_distinct(centres: np.ndarray) -> int:
    """How many centres (c, D), in standard deviations, differ by over SAME_CENTRE from all before them."""
    apart = np.abs(centres[:, None] - centres[None]).max(axis=-1) > SAME_CENTRE
    return sum(bool(apart[i, :i].all()) for i in range(len(centres)))


def _features(segments: Segments) -> np.ndarray:
    lines = np.stack([segments.slopes, segments.intercepts], axis=-1).reshape(len(segments.durations), -1)
    return np.column_stack([lines, segments.durations])


def _actions(features: np.ndarray) -> ActionSet:
    durations = np.maximum(np.rint(features[:, -1]), 1)
    slopes, intercepts = features[:, :-1:2], features[:, 1:-1:2]
    return ActionSet(slopes.astype(np.float32), intercepts.astype(np.float32), durations.astype(np.int32))


def _with_last(features: np.ndarray, function: np.ufunc) -> np.ndarray:
    return np.column_stack([features[:, :-1], function(features[:, -1])])
