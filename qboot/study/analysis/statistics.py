"""Statistics over runs, on scipy.

A run that never reached a goal counts as an infinite number of episodes: quartiles and ranks then stay what they
are, and are infinite themselves when too few runs reached it.
"""

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from scipy import stats

RESAMPLES = 9_999
TIME_RESAMPLES = 1_999  # each of them is a curve


Values = TypeVar("Values", float, np.ndarray)


class Quartiles(NamedTuple, Generic[Values]):
    """The three quartiles of a sample; floats, or arrays of one shape."""

    lower: Values
    median: Values
    upper: Values


class Comparison(NamedTuple):
    """Two independent samples compared by the Mann-Whitney test."""

    p_value: float  # two-sided; 1 when all values are equal
    a12: float  # probability that a value of the first sample is the greater one, ties half (Vargha and Delaney)


def quartiles(values: np.ndarray, axis: int = 0) -> Quartiles[np.ndarray]:
    """Quartiles of `values` along `axis`, linear between two values; infinite values are allowed.

    Raises:
        ValueError: if there is no value.
    """
    return Quartiles(*_quantiles(values, (0.25, 0.5, 0.75), axis))


def on_grid(episodes: np.ndarray, scores: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """The last score at or before each episode of `grid` (G,); NaN before the first one.

    Args:
        episodes: (K,) increasing.
        scores: (K,) score reached at each.
        grid: (G,) episodes.
    """
    last = np.searchsorted(episodes, grid, side="right") - 1
    return np.where(last >= 0, np.asarray(scores, float)[np.maximum(last, 0)], np.nan)


def median_and_quartiles(curves: Sequence[tuple[np.ndarray, np.ndarray]], grid: np.ndarray) -> Quartiles[np.ndarray]:
    """Quartiles over runs of the score at each episode of `grid`; each (G,), NaN where a run has no score yet.

    Args:
        curves: episodes (K,) and scores (K,) of each run; K may differ.
        grid: (G,) episodes.

    Raises:
        ValueError: if there is no curve.
    """
    return quartiles(np.array([on_grid(episodes, scores, grid) for episodes, scores in curves]))


def times_to_goal(has_it: np.ndarray, episodes: np.ndarray) -> Quartiles[float]:
    """When the quartiles over runs of a score reach its top: the first episode in which enough runs have it at once.

    Args:
        has_it: (R, K) bool, whether a run has the top score in an episode; at least one run.
        episodes: (K,) increasing.

    Returns:
        Times, the lower quartile being that of the faster runs; infinite where there are never enough.
    """
    counts = has_it.sum(axis=0)[None]
    return Quartiles(*(float(_first_with(counts, episodes, _enough(len(has_it), q))[0]) for q in (0.75, 0.5, 0.25)))


def time_interval(has_it: np.ndarray, episodes: np.ndarray, level: float = 0.95, seed: int = 0) -> tuple[float, float]:
    """Bootstrap interval (percentiles, over runs) of the median's time of `times_to_goal`; NaN for fewer than two."""
    n = len(has_it)
    if n < 2:
        return np.nan, np.nan
    useful = has_it.any(axis=0)
    drawn = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=TIME_RESAMPLES).astype(np.float32)
    # Rounded, for the counts are whole numbers and the product of floats need not be.
    counts = np.rint(drawn @ has_it[:, useful].astype(np.float32))
    times = _first_with(counts, episodes[useful], _enough(n, 0.5))
    low, high = _quantiles(times, ((1 - level) / 2, (1 + level) / 2), 0)
    return float(low), float(high)


def mann_whitney(first: np.ndarray, second: np.ndarray) -> Comparison:
    """Compare samples (n,) and (m,) by their ranks: exact for few values without ties, else with continuity correction.

    Raises:
        ValueError: if a sample is empty.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    if not len(first) or not len(second):
        raise ValueError(f"the samples have {len(first)} and {len(second)} values: both need at least 1")
    if len(np.unique(np.concatenate([first, second]))) == 1:
        return Comparison(1.0, 0.5)
    test = stats.mannwhitneyu(first, second)
    return Comparison(float(test.pvalue), float(test.statistic / (len(first) * len(second))))


def median_interval(values: np.ndarray, level: float = 0.95, seed: int = 0) -> tuple[float, float]:
    """Bootstrap confidence interval (percentiles) of the median of `values` (n,); NaN for fewer than two values."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return np.nan, np.nan
    rng = np.random.default_rng(seed)
    with np.errstate(invalid="ignore"):  # its standard error is not a number where values are infinite
        found = stats.bootstrap((values,), np.median, n_resamples=RESAMPLES, method="percentile", rng=rng)
    medians = found.bootstrap_distribution
    low, high = _quantiles(medians, ((1 - level) / 2, (1 + level) / 2), 0)
    return float(low), float(high)


def difference_interval(
    first: np.ndarray, second: np.ndarray, level: float = 0.9, seed: int = 0
) -> tuple[float, float]:
    """Bootstrap interval (percentiles) of median(first) - median(second); NaN if one has fewer than two values.

    With a level of 0.9 it lies within a margin exactly when two one-sided tests at 5 % both reject a difference
    beyond it.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    if min(len(first), len(second)) < 2:
        return np.nan, np.nan

    def difference(one: np.ndarray, other: np.ndarray, axis: int) -> np.ndarray:
        return np.median(one, axis=axis) - np.median(other, axis=axis)

    found = stats.bootstrap(
        (first, second), difference, n_resamples=RESAMPLES, confidence_level=level, method="percentile", rng=seed
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def a12_interval(first: np.ndarray, second: np.ndarray, level: float = 0.95, seed: int = 0) -> tuple[float, float]:
    """Bootstrap confidence interval (percentiles) of A12 of samples (n,) and (m,); NaN if one has fewer than two."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    if min(len(first), len(second)) < 2:
        return np.nan, np.nan

    def a12(one: np.ndarray, other: np.ndarray, axis: int) -> np.ndarray:
        one, other = one[..., :, None], other[..., None, :]
        return ((one > other) + 0.5 * (one == other)).mean(axis=(-2, -1))

    found = stats.bootstrap(
        (first, second), a12, n_resamples=RESAMPLES, confidence_level=level, method="percentile", rng=seed
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def _enough(n: int, share: float) -> int:
    """How many of n values must be the greatest possible for the quantile `share`, linear between two, to be it."""
    return n - int(np.floor(share * (n - 1)))


def _first_with(counts: np.ndarray, episodes: np.ndarray, enough: int) -> np.ndarray:
    """The first of `episodes` (K,) with `enough` of the `counts` (B, K), (B,); infinite where there is none."""
    if not len(episodes):
        return np.full(len(counts), np.inf)
    there = counts >= enough
    return np.where(there.any(axis=1), np.asarray(episodes, float)[there.argmax(axis=1)], np.inf)


def _quantiles(values: np.ndarray, shares: tuple[float, ...], axis: int) -> np.ndarray:
    values = np.asarray(values, float)
    if not values.shape[axis]:
        raise ValueError("no values: quantiles need at least 1")
    with np.errstate(invalid="ignore"):
        between = np.quantile(values, shares, axis=axis)
    lower, higher = (np.quantile(values, shares, axis=axis, method=method) for method in ("lower", "higher"))
    # NumPy's interpolation is not a number next to an infinite value.
    return np.where(lower == higher, lower, np.where(np.isinf(higher), higher, between))
