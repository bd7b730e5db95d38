import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import cdist

from qboot.envs import get_task
from qboot.envs.ball_collecting import expert as expert_ball_collecting
from qboot.envs.box_pushing import arm
from qboot.envs.box_pushing import expert as expert_box_pushing
from qboot.extraction import baselines
from qboot.extraction.actions import SCALES, ActionSet, ActionSettings, cluster_actions, commands, fit_scaling
from qboot.extraction.clustering import CLUSTERINGS, cluster, fuzzy_c_means
from qboot.extraction.segmentation import Segments


def test_segments_of_odd_shapes_are_refused():
    slopes, durations = np.zeros((20, 3)), np.full(20, 10)
    for odd in (
        Segments(slopes, np.zeros((20, 2)), durations),
        Segments(slopes, slopes, durations[:-1]),
        Segments(slopes[:, 0], slopes[:, 0], durations),
    ):
        with pytest.raises(AssertionError):
            cluster_actions(odd, ActionSettings(n_actions=2, long_segments="clip"), seed=0)


def bezdek(points, centres, m, iterations):
    """Fuzzy c-means as in the textbook, in double precision, from given centres."""

    def memberships(centres):
        distance = np.maximum(cdist(points, centres), 1e-12)
        return 1 / ((distance[:, :, None] / distance[:, None, :]) ** (2 / (m - 1))).sum(axis=2)

    for _ in range(iterations):
        weights = memberships(centres) ** m
        centres = np.stack([np.average(points, axis=0, weights=column) for column in weights.T])
    return centres, memberships(centres)


def blobs(n, centres, noise, seed):
    random = np.random.default_rng(seed)
    return centres[random.integers(len(centres), size=n)] + noise * random.normal(size=(n, centres.shape[1]))


@pytest.mark.parametrize("m", [1.3, 2.0, 3.0])
def test_fuzzy_c_means_ends_at_a_fixed_point_of_the_textbook(m):
    points = blobs(400, np.random.default_rng(0).uniform(97, 103, size=(4, 3)), 0.4, 1)
    found = cluster(points, 4, m, seed=0, max_iterations=500, tolerance=1e-6)
    centres, memberships = bezdek(points, found.centres, m, 1)
    assert found.iterations < 500
    np.testing.assert_allclose(found.centres, centres, atol=2e-4)
    np.testing.assert_allclose(found.memberships, memberships, atol=2e-3)


def test_fuzzy_c_means_follows_the_textbook_step_by_step():
    points = blobs(300, np.random.default_rng(3).uniform(-3, 3, size=(3, 2)), 0.5, 2)
    first, _ = bezdek(points, fuzzy_c_means(points, 3, 2.0, seed=5, max_iterations=1, tolerance=0)[0], 2.0, 6)
    seventh, _ = fuzzy_c_means(points, 3, 2.0, seed=5, max_iterations=7, tolerance=0)
    np.testing.assert_allclose(seventh, first, atol=1e-4)


ON_SO_MANY_CORES = """
import os, sys
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])
import numpy as np
from qboot.extraction.clustering import fuzzy_c_means
points = np.random.default_rng(0).normal(size=(60_000, 7))
centres, memberships = fuzzy_c_means(points, 5, 1.3, seed=0, max_iterations=10)
print(centres.tobytes().hex(), hash(memberships.tobytes()))
"""


@pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: ())(0)) < 2, reason="needs two cores, and Linux")
def test_fuzzy_c_means_does_not_depend_on_the_cores():
    """XLA splits a large sum among as many threads as there are cores, which rounds it differently."""
    found = [
        subprocess.run(
            [sys.executable, "-c", ON_SO_MANY_CORES, n], capture_output=True, text=True, check=True,
            env=os.environ | {"PYTHONHASHSEED": "0"},
        ).stdout
        for n in ("1", "2")
    ]  # fmt: skip
    assert found[0] and found[0] == found[1]


def test_fuzzy_c_means_by_hand():
    # By symmetry the centres are +-c, and m = 2 gives memberships d^-2: u(1) = (1+c)^2 / ((1-c)^2 + (1+c)^2).
    # c = (u(1)^2 - u(-1)^2) / (u(1)^2 + u(-1)^2) has the solution 1: each centre lies on its point.
    centres, memberships = fuzzy_c_means(np.array([[-1.0], [1.0]]), 2, 2.0, seed=0)
    np.testing.assert_allclose(np.sort(centres[:, 0]), [-1, 1], atol=1e-6)
    np.testing.assert_allclose(np.sort(memberships, axis=1), [[0, 1], [0, 1]], atol=1e-6)
    # One cluster: the mean, whatever the fuzziness.
    centres, memberships = fuzzy_c_means(np.array([[0.0], [1.0], [5.0]]), 1, 2.0, seed=0)
    np.testing.assert_allclose(centres, [[2.0]], atol=1e-6)
    np.testing.assert_array_equal(memberships, np.ones((3, 1)))


@settings(max_examples=30, deadline=None)
@given(
    points=arrays(np.float64, (12, 2), elements=st.integers(-3, 3).map(float)),  # many duplicates
    n_clusters=st.sampled_from([1, 5, 12]),
    m=st.sampled_from([1.05, 1.3, 2.0]),
)
@pytest.mark.filterwarnings("ignore:.*")
def test_memberships_sum_to_one_and_centres_stay_among_the_points(points, n_clusters, m):
    centres, memberships = fuzzy_c_means(points, n_clusters, m, seed=0)
    np.testing.assert_allclose(memberships.sum(axis=1), 1, atol=1e-5)
    assert (memberships >= 0).all()
    assert (centres >= points.min(axis=0) - 1e-4).all()
    assert (centres <= points.max(axis=0) + 1e-4).all()


def test_fuzzy_c_means_depends_on_the_seed_alone():
    points = np.random.default_rng(0).normal(size=(200, 3))
    one, two = fuzzy_c_means(points, 5, 1.3, seed=1), fuzzy_c_means(points, 5, 1.3, seed=1)
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros(3)}, "shape"),
        ({"points": np.full((9, 2), np.inf)}, "finite"),
        ({"n_clusters": 10}, "n_clusters must lie between 1 and the 9 points"),
        ({"n_clusters": 0}, "n_clusters"),
        ({"m": 1.0}, "m must be greater than 1"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"tolerance": -1.0}, "tolerance"),
    ],
)
def test_fuzzy_c_means_refuses_bad_arguments(change, message):
    with pytest.raises(ValueError, match=message):
        fuzzy_c_means(**{"points": np.zeros((9, 2)), "n_clusters": 3, "m": 2.0, "seed": 0} | change)


def test_commands_are_clipped_lines_under_jit():
    actions = ActionSet(
        np.array([[0.1, -0.2], [0.0, 0.0]], np.float32),
        np.array([[0.5, 0.3], [1.5, 0.25]], np.float32),
        np.array([10, 3], np.int32),
    )
    np.testing.assert_allclose(commands(actions, 0, 1), [0.6, 0.1], atol=1e-6)
    np.testing.assert_allclose(jax.jit(commands)(actions, 0, 9), [1.0, 0.0], atol=1e-6)
    closed_over = jax.jit(lambda a, t: commands(actions, a, t))
    both = closed_over(jnp.array([0, 1]), jnp.array([1, 2]))
    np.testing.assert_allclose(both, [[0.6, 0.1], [1.0, 0.25]], atol=1e-6)


@pytest.mark.parametrize("scale", SCALES)
def test_scaling_can_be_undone(scale):
    features = np.random.default_rng(0).uniform(0.1, 5, size=(50, 4))
    features[:, 1] = 0.3  # constant
    scaling = fit_scaling(features, scale)
    scaled = scaling.apply(features)
    np.testing.assert_allclose(scaling.undo(scaled), features, atol=1e-12)
    if scale == "minmax":
        np.testing.assert_allclose(np.ptp(scaled, axis=0), [1, 0, 1, 1], atol=1e-12)
    if scale in ("std", "logstd"):
        np.testing.assert_allclose(scaled.std(axis=0), [1, 0, 1, 1], atol=1e-12)


def prototypes(n, seed):
    """Segments scattered around four known actions of two effectors."""
    random = np.random.default_rng(seed)
    kind = random.integers(4, size=n)
    slopes = np.array([[0.0, 0.02], [0.0, 0.0], [-0.01, 0.0], [0.03, -0.03]])
    intercepts = np.array([[1.0, 0.0], [0.5, 0.5], [0.9, 0.1], [0.0, 1.0]])
    durations = np.array([5, 20, 60, 200])
    return Segments(
        slopes[kind] + 0.0005 * random.normal(size=(n, 2)),
        intercepts[kind] + 0.02 * random.normal(size=(n, 2)),
        np.maximum(np.rint(durations[kind] * np.exp(0.05 * random.normal(size=n))), 1).astype(int),
    ), ActionSet(slopes, intercepts, durations)


@pytest.mark.parametrize("scale", ["logstd", "std", "minmax"])
def test_clustering_finds_the_actions_that_the_segments_scatter_around(scale):
    segments, truth = prototypes(800, 0)
    settings = ActionSettings(n_actions=4, scale=scale, max_duration=1000)
    actions, info = cluster_actions(segments, settings, seed=0)
    order = np.argsort(actions.durations)
    np.testing.assert_allclose(actions.durations[order], truth.durations, rtol=0.05)
    np.testing.assert_allclose(actions.slopes[order], truth.slopes, atol=2e-3)
    np.testing.assert_allclose(actions.intercepts[order], truth.intercepts, atol=0.02)
    assert [field.dtype for field in actions] == [np.float32, np.float32, np.int32]
    assert (info.n_segments, info.n_distinct) == (800, 4)
    np.testing.assert_array_equal(info.durations_before, np.percentile(segments.durations, [25, 50, 75]))
    np.testing.assert_array_equal(info.durations_after, np.percentile(actions.durations, [25, 50, 75]))
    assert 1 <= info.iterations <= 300


@pytest.mark.parametrize("name", CLUSTERINGS)
def test_every_clustering_finds_as_many_centres_as_asked(name):
    segments, _ = prototypes(800, 0)
    chosen = ActionSettings(n_actions=4, scale="logstd", clustering=name, max_duration=1000)
    actions, info = cluster_actions(segments, chosen, seed=0)
    assert actions.slopes.shape == (4, 2) and info.n_distinct == 4
    assert_same(cluster_actions(segments, chosen, seed=0)[0], actions)


def assert_same(one, two):
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


def test_no_action_lasts_longer_than_asked():
    segments, _ = prototypes(800, 0)
    actions, info = cluster_actions(segments, ActionSettings(n_actions=4, max_duration=30), seed=0)
    assert actions.durations.max() <= 30
    assert info.n_segments == 800


def test_coinciding_actions_are_kept_and_reported():
    segments, _ = prototypes(200, 1)
    same = Segments(*(np.repeat(field[:2], 20, axis=0) for field in segments))
    with pytest.warns(UserWarning, match="only 2 of the 5 extracted actions are distinct"):
        actions, info = cluster_actions(same, ActionSettings(n_actions=5), seed=0)
    assert info.n_distinct == 2
    assert len(actions.durations) == 5
    assert np.isfinite(actions.slopes).all()


def test_actions_need_enough_segments():
    segments, _ = prototypes(5, 0)
    with pytest.raises(ValueError, match="17 actions need at least as many segments, got 5"):
        cluster_actions(segments, ActionSettings(max_duration=1000), seed=0)
    with pytest.raises(ValueError, match="17 actions need at least as many segments, got 0"):
        cluster_actions(segments, ActionSettings(max_duration=8, long_segments="drop"), seed=0)


@pytest.mark.parametrize(
    "change",
    [
        {"n_actions": 0},
        {"fuzziness": 1.0},
        {"fuzziness": np.inf},
        {"scale": "log"},
        {"duration_unit": np.nan},
        {"max_duration": 7},
        {"max_iterations": 0},
        {"tolerance": -1.0},
        {"tolerance": np.inf},
        {"segmentation": "by hand"},
        {"clustering": "by hand"},
    ],
)
def test_settings_outside_their_range_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        ActionSettings(**change)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 20), st.integers(1, 4), st.integers(1, 30), st.integers(0, 30))
def test_random_actions_end_in_range(seed, n_actions, n_effectors, shortest, more):
    actions = baselines.random_actions(seed, n_actions, n_effectors, (shortest, shortest + more))
    assert ((shortest <= actions.durations) & (actions.durations <= shortest + more)).all()
    last = actions.intercepts + actions.slopes * (actions.durations[:, None] - 1)
    for ends in (actions.intercepts, last):
        assert ends.shape == (n_actions, n_effectors)
        assert (ends >= -1e-6).all()
        assert (ends <= 1 + 1e-6).all()


def test_random_actions_reach_both_ends_of_the_durations_and_refuse_bad_ones():
    durations = baselines.random_actions(0, 500, 3, (2, 5)).durations
    assert set(durations.tolist()) == {2, 3, 4, 5}
    for durations in ((0, 5), (6, 5)):
        with pytest.raises(ValueError, match="durations"):
            baselines.random_actions(0, 4, 3, durations)
    with pytest.raises(ValueError, match="n_actions"):
        baselines.random_actions(0, 0, 3, (2, 5))


def test_human_actions_for_ball_collecting():
    actions = expert_ball_collecting.actions()
    left, right, crane = actions.intercepts.T
    turn = left - right
    assert actions.durations.tolist() == [15] * 17
    assert (actions.slopes == 0).all()
    assert crane.tolist() == [1] * 16 + [0]
    assert (np.diff(turn[:16]) > 0).all()
    assert (left[0], right[0]) == (0.5, 1)
    assert (left[8], right[8]) == (1, 1)
    assert (np.minimum(left, right) >= 0.5).all()
    assert (np.maximum(left, right)[:16] == 1).all()
    assert (left[16], right[16]) == (0.5, 0.5)


def test_human_actions_for_box_pushing():
    actions = expert_box_pushing.actions()
    assert actions.durations.tolist() == [9] * 7
    assert actions.intercepts.shape == (7, 3)
    assert actions.intercepts[0].tolist() == [0.5] * 3
    assert len(np.unique(actions.intercepts, axis=0)) == 7
    # Each move is as far as said, by the arm's own account of a step.
    moves = 9 * (actions.intercepts - 0.5) * arm.STEP_PER_COMMAND
    np.testing.assert_allclose(np.linalg.norm(moves[1:], axis=1), 0.04, rtol=1e-5)
    with pytest.raises(ValueError, match="distance"):
        expert_box_pushing.actions(1)
    with pytest.raises(ValueError, match="duration"):
        expert_ball_collecting.actions(0)


@pytest.mark.parametrize("name", ["ball_collecting", "box_pushing"])
def test_human_sensors_are_the_present_and_some_of_the_past(name):
    task = get_task(name)
    selection = baselines.chosen_sensors(task.expert.sensors, task.sensors)
    assert selection.shape == (len(task.expert.sensors), len(task.sensors))
    assert selection[0].all()
    assert 0 < selection[1:].sum() < selection[1:].size


def test_sensors_are_selected_by_name_and_lag():
    assert baselines.chosen_sensors(("ab", "", "c"), "abc").tolist() == [[1, 1, 0], [0, 0, 0], [0, 0, 1]]
    with pytest.raises(ValueError, match="unknown sensors d: choose among a, b, c"):
        baselines.chosen_sensors(("ad",), "abc")


@settings(deadline=None)
@given(st.integers(0, 1000), st.integers(1, 12), st.integers(1, 13))
def test_random_sensors_are_as_many_as_asked(seed, lags, n_sensors):
    free = baselines.random_sensors(seed, lags, n_sensors)
    assert free.shape == (lags, n_sensors) and 1 <= free.sum() <= free.size
    for n_inputs in (1, free.size):
        assert baselines.random_sensors(seed, lags, n_sensors, n_inputs).sum() == n_inputs


def test_random_sensors_are_drawn_evenly():
    numbers = [baselines.random_sensors(seed, 12, 13).sum() for seed in range(2000)]
    assert min(numbers) <= 3 and max(numbers) >= 154
    assert abs(np.mean(numbers) - 78.5) < 4 * np.sqrt((156**2 - 1) / 12 / 2000)
    shares = np.mean([baselines.random_sensors(seed, 12, 13, 39) for seed in range(2000)], axis=0)
    np.testing.assert_allclose(shares, 0.25, atol=0.05)
    with pytest.raises(ValueError, match="between 1 and 156"):
        baselines.random_sensors(0, 12, 13, 157)


def test_restarts_find_a_smaller_sum():
    """Of several starts the best is kept: the sum that is minimised, computed from its definition, is the least."""
    rng = np.random.default_rng(1)
    # Ten blobs: two first centres in one of them, and the search can end with a blob that has none.
    points = np.concatenate([centre + 0.02 * rng.normal(size=(20, 2)) for centre in rng.uniform(size=(10, 2))])

    def total(found):
        return (found.memberships**1.3 * cdist(points, found.centres, "sqeuclidean")).sum()

    singles = [total(cluster(points, 10, 1.3, seed)) for seed in range(12, 18)]
    assert max(singles) > 1.04 * min(singles)
    assert total(cluster(points, 10, 1.3, seed=2, restarts=6)) == pytest.approx(min(singles))
    with pytest.raises(ValueError, match="restarts"):
        cluster(points, 8, 1.3, seed=0, restarts=0)
