from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from qboot.extraction.actions import ActionSettings
from qboot.extraction.segmentation import (
    LONG_SEGMENTS,
    SEGMENTATIONS,
    Segments,
    cut_segments,
    join_segments,
    linear_segments,
    segment,
    split_points,
)
from qboot.extraction.traces import Trace
from qboot.study.pipeline.extracting import at_decisions

# Sixteenths, and 1, 2 or 4 effectors: sums and means are exact, so ties are ties in any order of summing.
exact_commands = st.tuples(st.sampled_from([1, 2, 4]), st.sampled_from([1, 2, 3, 8, 16, 32])).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.integers(0, 16).map(lambda i: i / 16))
)


def paper_split_points(commands):
    """SPLIT POINTS, line by line (section IV-C)."""
    n_e, n_h = len(commands), len(commands[0])
    second = [[0.0] * n_h for _ in range(n_e)]
    for e in range(n_e):
        for t in range(1, n_h - 1):
            second[e][t] = commands[e][t - 1] - 2 * commands[e][t] + commands[e][t + 1]
    M = [sum(abs(second[e][t]) for e in range(n_e)) / n_e for t in range(n_h)]
    L = sum(M) / n_h
    P = [int(x > L) for x in M]
    i = 0
    while i < n_h - 1:
        j = 1
        if P[i] == 1:
            while i + j < n_h and P[i + j] == 1:
                j = j + 1
            if j == 2:
                k = i + [M[i], M[i + 1]].index(min(M[i], M[i + 1]))
                P[k] = 0
            elif j > 2:
                P[i + 1 : i + j - 2 + 1] = [0] * (j - 2)
        i = i + j
    return np.array(P, bool)


@settings(max_examples=300, deadline=None)
@given(exact_commands)
def test_split_points_are_those_of_the_pseudo_code(commands):
    np.testing.assert_array_equal(split_points(commands), paper_split_points(commands.tolist()))


@pytest.mark.parametrize("n_effectors", [1, 3])
def test_split_points_of_a_long_rough_flow(n_effectors):
    walk = np.random.default_rng(n_effectors).normal(size=(n_effectors, 5000)).cumsum(axis=1)
    np.testing.assert_array_equal(split_points(walk), paper_split_points(walk.tolist()))


@pytest.mark.parametrize(
    ("commands", "points"),
    [
        ([0, 0, 0, 1, 2, 3], [2]),  # a kink
        ([0, 0, 0, 1, 1, 1], [3]),  # a step: two equal candidates, the first is dropped
        ([0, 0, 0, 2, 3, 4, 5], [2]),  # candidates of 2 and 1: the weaker is dropped
        ([0, 0, 0, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0], [3, 9]),  # an oscillation: only its ends are kept
        ([3, 3, 3, 3], []),
        ([0, 1], []),
        ([5], []),
    ],
)
def test_split_points_by_hand(commands, points):
    assert np.flatnonzero(split_points(np.array([commands]))).tolist() == points


@settings(max_examples=100, deadline=None)
@given(exact_commands)
def test_segments_partition_the_flow_and_are_least_squares_lines(commands):
    segments = linear_segments(commands)
    starts = np.cumsum(segments.durations) - segments.durations
    assert segments.durations.sum() == commands.shape[1]
    assert (segments.durations >= 1).all()
    np.testing.assert_array_equal(starts[1:], np.flatnonzero(split_points(commands)))
    for start, duration, slopes, intercepts in zip(
        starts, segments.durations, segments.slopes, segments.intercepts, strict=True
    ):
        piece = commands[:, start : start + duration]
        if duration == 1:
            expected = np.stack([np.zeros(len(piece)), piece[:, 0]])
        else:
            expected = np.polyfit(np.arange(duration), piece.T, 1)
        np.testing.assert_allclose([slopes, intercepts], expected, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(
    durations=st.lists(st.integers(3, 12), min_size=2, max_size=8),
    first_slopes=arrays(np.float64, 3, elements=st.integers(-8, 8).map(lambda i: i / 64)),
    bend=arrays(np.float64, 3, elements=st.sampled_from([-0.25, 0.25])),
)
def test_continuous_piecewise_linear_flow_is_recovered(durations, first_slopes, bend):
    # Slopes go back and forth by `bend`, so that every corner is as sharp as any other.
    slopes = first_slopes + bend * (np.arange(len(durations)) % 2)[:, None]
    steps = np.repeat(slopes, durations, axis=0)
    flow = np.concatenate([np.zeros((1, 3)), steps.cumsum(axis=0)])[:-1].T
    segments = linear_segments(flow)
    np.testing.assert_array_equal(segments.durations, durations)
    np.testing.assert_allclose(segments.slopes, slopes, atol=1e-12)
    starts = np.cumsum(durations) - durations
    np.testing.assert_allclose(segments.intercepts, flow[:, starts].T, atol=1e-12)


def test_join_segments():
    one, two = linear_segments(np.zeros((2, 4))), linear_segments(np.array([[0, 0, 0, 1, 2, 3.0]] * 2))
    joined = join_segments([one, two])
    assert joined.durations.tolist() == [4, 2, 4]
    assert joined.slopes.shape == joined.intercepts.shape == (3, 2)
    assert isinstance(joined, Segments)
    with pytest.raises(ValueError, match="no segments"):
        join_segments([])


@pytest.mark.parametrize("flow", [np.zeros(5), np.zeros((0, 5)), np.zeros((2, 0)), np.full((2, 5), np.inf)])
def test_unusable_commands_are_refused(flow):
    with pytest.raises(ValueError, match="commands must"):
        split_points(flow)
    with pytest.raises(ValueError, match="commands must"):
        linear_segments(flow)


@pytest.mark.parametrize("name", SEGMENTATIONS)
def test_every_method_cuts_all_of_each_flow(name):
    flows = [np.random.default_rng(seed).random((steps, 2)) for seed, steps in enumerate((300, 5, 80))]
    segments = segment(flows, ActionSettings(segmentation=name, min_duration=4))
    assert np.cumsum(segments.durations).tolist()[-1] == 385
    assert {300, 305} <= set(np.cumsum(segments.durations).tolist()), "no segment spans two flows"
    assert segments.durations.min() >= 4
    assert segments.slopes.shape == segments.intercepts.shape == (len(segments.durations), 2)


def test_short_segments_are_joined():
    random = np.random.default_rng(0)
    commands = random.random((2, 300))
    for shortest in (1, 2, 8, 40):
        durations = linear_segments(commands, shortest).durations
        assert durations.min() >= shortest and durations.sum() == 300
    assert linear_segments(commands, 400).durations.tolist() == [300]
    starts = np.append(0, np.cumsum(linear_segments(commands, 8).durations)[:-1])
    assert set(starts[1:]) <= set(np.flatnonzero(split_points(commands)))


def test_cut_segments_send_the_same_commands():
    random = np.random.default_rng(0)
    segments = Segments(random.normal(size=(6, 2)), random.normal(size=(6, 2)), np.array([1, 5, 10, 11, 30, 99]))
    parts = cut_segments(segments, 10)
    assert parts.durations.max() <= 10 and parts.durations.sum() == segments.durations.sum()
    np.testing.assert_allclose(flow_of(parts), flow_of(segments), atol=1e-12)
    assert parts.durations.tolist()[:6] == [1, 5, 10, 5, 6, 10]
    with pytest.raises(ValueError, match="longest"):
        cut_segments(segments, 0)


def test_long_segments_are_clipped_or_dropped():
    """Three pieces of a hundred steps would be three points of the same line; clipped it is one, dropped none."""
    random = np.random.default_rng(0)
    segments = Segments(random.normal(size=(4, 2)), random.normal(size=(4, 2)), np.array([1, 20, 21, 300]))
    clipped, dropped = (LONG_SEGMENTS[name](segments, 20) for name in ("clip", "drop"))
    assert clipped.durations.tolist() == [1, 20, 20, 20] and dropped.durations.tolist() == [1, 20]
    np.testing.assert_array_equal(clipped.slopes, segments.slopes)
    np.testing.assert_array_equal(dropped.intercepts, segments.intercepts[:2])
    for handle in LONG_SEGMENTS.values():
        with pytest.raises(ValueError, match="longest"):
            handle(segments, 0)


def test_a_trace_at_its_decisions_has_a_row_for_each_segment():
    random = np.random.default_rng(0)
    steps = np.arange(200)
    levels = np.repeat(random.uniform(size=(4, 2)), 50, axis=0)  # a command that changes every 50 steps
    trace = Trace(np.stack([steps, -steps], axis=1), levels)
    settings = ActionSettings(min_duration=5, max_duration=30)
    run = SimpleNamespace(settings=SimpleNamespace(actions=settings))
    [thin] = at_decisions(run, [trace])
    starts = thin.observations[:, 0]
    durations = np.diff(np.append(starts, 200))
    np.testing.assert_array_equal(durations, cut_segments(segment([levels], settings), 30).durations)
    assert starts[0] == 0 and durations.max() <= 30
    np.testing.assert_array_equal(thin.commands, levels[starts])


def flow_of(segments):
    """The commands (T, E) that segments stand for."""
    lines = zip(segments.slopes, segments.intercepts, segments.durations, strict=True)
    return np.concatenate([np.arange(d)[:, None] * slope + intercept for slope, intercept, d in lines])
