"""Statistics over runs, against hand-made cases and scipy."""

import numpy as np
import pytest
from scipy import stats

from qboot.study.analysis import statistics


def test_quartiles_of_finite_values_are_numpys():
    values = np.random.default_rng(0).normal(size=(7, 3))
    found = statistics.quartiles(values)
    np.testing.assert_allclose(found, np.quantile(values, [0.25, 0.5, 0.75], axis=0))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, 2, 3, 4, np.inf], (2, 3, 4)),
        ([1, 2, 3, np.inf, np.inf], (2, 3, np.inf)),
        ([1, np.inf, np.inf, np.inf, np.inf], (np.inf, np.inf, np.inf)),
        ([1, np.inf], (np.inf, np.inf, np.inf)),
        ([5], (5, 5, 5)),
    ],
)
def test_quartiles_when_some_runs_never_got_there(values, expected):
    assert tuple(map(float, statistics.quartiles(np.array(values, float)))) == expected


def test_quartiles_keep_what_is_no_number():
    assert np.isnan(statistics.quartiles(np.array([1.0, np.nan])).median)


def test_no_values_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        statistics.quartiles(np.array([]))
    with pytest.raises(ValueError, match="at least 1"):
        statistics.mann_whitney([], [1.0])
    with pytest.raises(ValueError, match="at least 1"):
        statistics.median_and_quartiles([], np.array([1]))


def test_a_curve_holds_its_last_value():
    found = statistics.on_grid(np.array([10, 20, 40]), np.array([1, 3, 2]), np.array([5, 10, 19, 20, 39, 40, 99]))
    np.testing.assert_array_equal(found, [np.nan, 1, 1, 3, 3, 2, 2])


def test_median_and_quartiles_over_runs():
    curves = [(np.array([1, 3]), np.array([0, score])) for score in (1, 2, 3, 4, 5)]
    found = statistics.median_and_quartiles(curves, np.array([0, 1, 2, 3]))
    np.testing.assert_array_equal(found.median, [np.nan, 0, 0, 3])
    np.testing.assert_array_equal(found.lower, [np.nan, 0, 0, 2])
    np.testing.assert_array_equal(found.upper, [np.nan, 0, 0, 4])


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8])
def test_times_to_a_goal_are_those_of_the_quartiles_curves(n):
    """By the curves of NumPy's quantiles over runs, with a score that has a greatest value."""
    rng = np.random.default_rng(n)
    scores, episodes = rng.integers(6, 9, (n, 40)), np.arange(10, 410, 10)
    found = statistics.times_to_goal(scores == 8, episodes)
    for time, share in zip(found, (0.75, 0.5, 0.25), strict=True):
        reached = np.flatnonzero(np.quantile(scores, share, axis=0) >= 8)
        assert time == (episodes[reached[0]] if len(reached) else np.inf)
    low, high = statistics.time_interval(scores == 8, episodes)
    assert low <= found.median <= high


def test_the_interval_of_a_difference_shrinks_around_it():
    rng = np.random.default_rng(0)
    wide, narrow = (
        statistics.difference_interval(rng.normal(3, 1, n), rng.normal(2, 1, n), level=0.9) for n in (10, 1_000)
    )
    assert narrow[0] < 1 < narrow[1]
    assert 0 < narrow[1] - narrow[0] < 0.3 < wide[1] - wide[0]
    assert np.isnan(statistics.difference_interval(np.ones(1), np.ones(5))).all()


def test_mann_whitney_is_scipys_and_a12_counts_pairs():
    generator = np.random.default_rng(1)
    first, second = generator.integers(0, 9, 30), generator.integers(2, 12, 25)
    found = statistics.mann_whitney(first, second)
    assert found.p_value == stats.mannwhitneyu(first, second, alternative="two-sided").pvalue
    greater = (first[:, None] > second).mean() + (first[:, None] == second).mean() / 2
    assert found.a12 == pytest.approx(greater)


def test_mann_whitney_at_the_ends():
    assert statistics.mann_whitney([1, 2, 3], [4, 5, 6]) == (pytest.approx(0.1), 0.0)
    assert statistics.mann_whitney([0, 0], [0, 0, 0]) == (1.0, 0.5)
    assert statistics.mann_whitney([np.inf, np.inf], [1, 2]).a12 == 1.0


def test_the_interval_of_the_median_is_scipys_and_repeatable():
    values = np.random.default_rng(2).normal(size=30)
    low, high = statistics.median_interval(values)
    expected = stats.bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0))
    assert (low, high) == pytest.approx(tuple(expected.confidence_interval))
    assert (low, high) == statistics.median_interval(values)
    assert low < np.median(values) < high


def test_the_interval_may_be_open():
    low, high = statistics.median_interval(np.array([1.0, 2, 3, np.inf, np.inf]))
    assert np.isfinite(low) and np.isinf(high)
    assert np.isnan(statistics.median_interval(np.array([1.0]))).all()


def test_the_interval_of_a12_holds_it_and_is_repeatable():
    generator = np.random.default_rng(3)
    first, second = generator.normal(0.8, 1, 30), generator.normal(0, 1, 25)
    low, high = statistics.a12_interval(first, second)
    assert (low, high) == statistics.a12_interval(first, second)
    assert low < statistics.mann_whitney(first, second).a12 < high
    # By hand: resample both, count pairs.
    pairs = [
        (generator.choice(first, 30)[:, None] > generator.choice(second, 25)[None, :]).mean() for _ in range(4_000)
    ]
    np.testing.assert_allclose((low, high), np.quantile(pairs, (0.025, 0.975)), atol=0.02)
    assert np.isnan(statistics.a12_interval([1.0], [2.0, 3.0])).all()
    assert statistics.a12_interval([4.0, 5.0], [1.0, 2.0]) == (1, 1)
