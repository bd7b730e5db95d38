"""Discrete actions with linear commands, and their extraction by clustering (paper, sections IV-B and IV-C).

Shape letters: A actions, E effectors, n segments, F = 2 E + 1 features.
"""

import math
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np

from qboot.extraction.clustering import CLUSTERINGS
from qboot.extraction.segmentation import LONG_SEGMENTS, SEGMENTATIONS, Segments

SCALES = ("none", "std", "minmax", "logstd")
# Centres nearer than this in every feature, in standard deviations of it, count as one.
SAME_CENTRE = 0.02


class ActionSet(NamedTuple):
    """The actions of a Q-learner, V_a of equation 6: linear commands for a number of steps.

    NumPy arrays where they are extracted and stored, JAX arrays where a learner uses them.
    """

    slopes: np.ndarray | jax.Array  # (A, E) float32 u, per step
    intercepts: np.ndarray | jax.Array  # (A, E) float32 v
    durations: np.ndarray | jax.Array  # (A,) int32 d, steps, >= 1


@dataclass(frozen=True)
class ActionSettings:
    """How actions are extracted. Raises `ValueError` when a value lies outside the range given under it."""

    n_actions: int = 17
    """Na: number of actions, >= 1 (17 for ball collecting, 7 for box pushing)."""

    segmentation: str = "second_derivative"
    """Name of the method that cuts commands into segments."""

    clustering: str = "fuzzy_c_means"
    """Name of the method that finds the most representative of them."""

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
    """Longest segment that is clustered as it is, in steps, >= 1: an action cannot be interrupted, and one of thousands
    of steps spends a whole rollout."""

    long_segments: str = "cut"
    """What becomes of longer ones: "cut" into parts of about equal length, "clip" to their first `max_duration` steps,
    or "drop"."""

    restarts: int = 10
    """Clusterings from different first centres, >= 1; the one with the smallest sum of distances is kept. Rare commands
    are easily missed by one: where no action lets go of a ball, nothing can be learned."""

    max_iterations: int = 300
    """Updates of the centres at most, >= 1."""

    tolerance: float = 1e-4
    """Stop when no centre moves by more than this share of the features' largest standard deviation, >= 0."""

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        for name, table in (
            ("segmentation", SEGMENTATIONS),
            ("clustering", CLUSTERINGS),
            ("scale", SCALES),
            ("long_segments", LONG_SEGMENTS),
        ):
            if getattr(self, name) not in table:
                raise ValueError(f"{name} is {getattr(self, name)!r}: it must be one of {', '.join(table)}")
        for name in ("n_actions", "min_duration", "restarts", "max_iterations"):
            if not getattr(self, name) >= 1:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least 1")
        if not self.max_duration >= self.min_duration:
            raise ValueError(
                f"max_duration is {self.max_duration}: it must be at least min_duration, which is {self.min_duration}"
            )
        for name, above in (("fuzziness", 1), ("duration_unit", 0)):
            if not above < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be finite and above {above}")
        if not 0 <= self.tolerance < math.inf:
            raise ValueError(f"tolerance is {self.tolerance}: it must be finite and not negative")


class ActionInfo(NamedTuple):
    """What an extraction of actions is reported by."""

    n_segments: int  # as split, before what is done about long ones
    n_distinct: int  # of the centres; fewer than n_actions when some coincide
    durations_before: np.ndarray  # (3,) quartiles over the segments, steps
    durations_after: np.ndarray  # (3,) quartiles over the actions, steps
    iterations: int  # of the clustering


class Scaling(NamedTuple):
    """Feature scaling that can be undone: minus `origin`, over `unit`, the last feature's log if `is_log`."""

    is_log: bool
    origin: np.ndarray  # (F,)
    unit: np.ndarray  # (F,), > 0

    def apply(self, features: np.ndarray) -> np.ndarray:
        """Scaled features (n, F)."""
        return ((_with_last(features, np.log) if self.is_log else features) - self.origin) / self.unit

    def undo(self, scaled: np.ndarray) -> np.ndarray:
        """Raw features (n, F)."""
        features = scaled * self.unit + self.origin
        return _with_last(features, np.exp) if self.is_log else features


def commands(actions: ActionSet, a: jax.Array, t: jax.Array) -> jax.Array:
    """Commands Gamma_a(t) of action `a` at its step `t` (equations 4 and 5), clipped to the effectors' range [0, 1].

    Works under jit and vmap. `a` and `t` are () or of equal shape (...); returns (E,) or (..., E).
    """
    chex.assert_equal_shape([jnp.asarray(a), jnp.asarray(t)])
    time = jnp.asarray(t)[..., None]
    # A traced index cannot pick from a NumPy array.
    slopes, intercepts = jnp.asarray(actions.slopes)[a], jnp.asarray(actions.intercepts)[a]
    return jnp.clip(slopes * time.astype(slopes.dtype) + intercepts, 0.0, 1.0)


def cluster_actions(segments: Segments, settings: ActionSettings, seed: int) -> tuple[ActionSet, ActionInfo]:
    """The most representative actions: centres of clusters of (u_1, v_1, ..., u_E, v_E, d), V_a of equation 6.

    All `n_actions` centres are returned, coinciding ones too (with a warning), so that a Q-learner's shape
    does not depend on the data. Durations are rounded to whole steps, at least 1.

    Args:
        segments: n of them.
        settings: number of actions, scaling, method and its settings.
        seed: decides all that is random.

    Raises:
        AssertionError: if the shapes of the segments' arrays do not fit each other.
        ValueError: if there are fewer segments than actions.
    """
    chex.assert_rank([segments.slopes, segments.durations], [2, 1])
    chex.assert_equal_shape([segments.slopes, segments.intercepts])
    chex.assert_equal_shape_prefix([segments.slopes, segments.durations], 1)
    features = _features(LONG_SEGMENTS[settings.long_segments](segments, settings.max_duration))
    if len(features) < settings.n_actions:
        raise ValueError(
            f"{settings.n_actions} actions need at least as many segments, got {len(features)}: "
            "use more or longer traces, or fewer actions."
        )
    scaling = fit_scaling(features, settings.scale, settings.duration_unit)
    found = CLUSTERINGS[settings.clustering](scaling.apply(features), settings, seed)
    chex.assert_shape(found.centres, (settings.n_actions, features.shape[1]))
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
    """The scaling `scale` (one of SCALES) of features (n, F); constant features are only shifted."""
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
    """How many centres (c, F), in standard deviations, differ by over SAME_CENTRE from all before them."""
    apart = np.abs(centres[:, None] - centres[None]).max(axis=-1) > SAME_CENTRE
    return sum(bool(apart[i, :i].all()) for i in range(len(centres)))


def _features(segments: Segments) -> np.ndarray:
    lines = np.stack([segments.slopes, segments.intercepts], axis=-1)
    lines = lines.reshape(len(segments.durations), 2 * segments.slopes.shape[1])
    return np.column_stack([lines, segments.durations])


def _actions(features: np.ndarray) -> ActionSet:
    durations = np.maximum(np.rint(features[:, -1]), 1)
    slopes, intercepts = features[:, :-1:2], features[:, 1:-1:2]
    return ActionSet(slopes.astype(np.float32), intercepts.astype(np.float32), durations.astype(np.int32))


def _with_last(features: np.ndarray, function: np.ufunc) -> np.ndarray:
    return np.column_stack([features[:, :-1], function(features[:, -1])])
