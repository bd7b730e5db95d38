"""Other clusterings, segmentations and choices of sensors, on data whose structure is known."""

import sys

import numpy as np
import pytest

from qboot.extraction.actions import ActionSettings
from qboot.extraction.clustering import CLUSTERINGS
from qboot.extraction.segmentation import SEGMENTATIONS, hidden_state_segments
from qboot.extraction.sensors import SELECTIONS, SensorSettings, effector_votes, select
from qboot.extraction.traces import Trace

CENTRES = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]])


@pytest.mark.parametrize("name", CLUSTERINGS)
def test_well_separated_clusters_are_found(name):
    drawn = np.random.default_rng(0)
    labels = drawn.integers(3, size=300)
    features = CENTRES[labels] + 0.1 * drawn.normal(size=(300, 3))
    settings = ActionSettings(n_actions=3, clustering=name, restarts=5)
    found = CLUSTERINGS[name](features, settings, 1)
    nearest = np.linalg.norm(found.centres[:, None] - CENTRES[None], axis=-1).argmin(axis=1)
    assert sorted(nearest) == [0, 1, 2]
    np.testing.assert_allclose(found.centres, CENTRES[nearest], atol=0.05)
    np.testing.assert_allclose(found.memberships.sum(axis=1), 1, atol=1e-5)
    np.testing.assert_array_equal(nearest[found.memberships.argmax(axis=1)], labels)
    again = CLUSTERINGS[name](features, settings, 1)
    np.testing.assert_array_equal(found.centres, again.centres)
    assert np.isfinite(CLUSTERINGS[name](features, settings, 2**32 - 1).centres).all()  # the largest seed of a run


@pytest.mark.parametrize("name", ["k_means", "gaussian_mixture"])
def test_points_that_coincide_are_no_error(name):
    features = np.repeat([[0.0, 1.0], [2.0, 1.0]], 10, axis=0)
    found = CLUSTERINGS[name](features, ActionSettings(n_actions=3), 0)
    assert found.centres.shape == (3, 2) and np.isfinite(found.centres).all()


@pytest.mark.parametrize("name", SEGMENTATIONS)
def test_levels_of_commands_are_cut_where_they_change(name):
    levels, durations = np.array([[0.1, 0.9], [0.8, 0.2], [0.1, 0.9], [0.4, 0.4]]), [30, 20, 25, 40]
    commands = np.repeat(levels, durations, axis=0).T
    found = SEGMENTATIONS[name](commands, ActionSettings(n_actions=3, segmentation=name, min_duration=5))
    assert found.durations.sum() == 115
    rebuilt = np.concatenate(
        [
            found.intercepts[i] + np.arange(duration)[:, None] * found.slopes[i]
            for i, duration in enumerate(found.durations)
        ]
    )
    assert np.abs(rebuilt - commands.T).mean() < 0.02


def test_a_hidden_state_is_recognised_when_it_comes_back():
    drawn = np.random.default_rng(0)
    levels = np.repeat([0.2, 0.8, 0.2], [50, 30, 40])
    found = hidden_state_segments((levels + 0.02 * drawn.normal(size=120))[None], 2)
    np.testing.assert_array_equal(found.durations, [50, 30, 40])


@pytest.mark.parametrize("commands", [np.full((2, 7), 0.5), np.zeros((1, 1)), np.linspace(0, 1, 6)[None]])
def test_short_and_constant_flows_have_segments(commands):
    found = hidden_state_segments(commands, 7, 2)
    assert found.durations.sum() == commands.shape[1]
    assert np.isfinite(found.slopes).all()


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "hmmlearn.hmm", None)
    with pytest.raises(ValueError, match=r"needs hmmlearn: pip install 'qboot\[alternatives\]'"):
        hidden_state_segments(np.linspace(0, 1, 20)[None], 2)


def flows():
    """Four sensors: 0 and 1 drive themselves, 2 is noise, 3 is constant; the command follows 1, a step late, and 2."""
    drawn = np.random.default_rng(1)
    found = []
    for _ in range(5):
        seen = np.zeros((300, 4))
        for t in range(1, 300):
            seen[t, :2] = 0.9 * seen[t - 1, :2] + 0.3 * drawn.normal(size=2)
        seen[:, 2] = drawn.normal(size=300)
        late = np.concatenate([seen[:1, 1], seen[:-1, 1]])
        found.append(Trace(seen, (0.5 * late + 0.5 * seen[:, 2])[:, None]))
    return found


def test_what_a_command_depends_on_is_selected():
    chosen = select(flows(), SensorSettings(selection="lasso_of_commands", lags=3)).selected
    expected = np.zeros((3, 4), bool)
    expected[0, 2] = expected[1, 1] = True  # lag 1 is the observation of the command's own step
    np.testing.assert_array_equal(chosen, expected)
    assert effector_votes(flows(), 3).explained[0] > 0.99


def test_a_forest_needs_what_the_future_depends_on():
    chosen = select(flows(), SensorSettings(selection="forest", lags=3))
    assert chosen.selected[0, :2].all()
    assert not chosen.selected[:, 2:].any()
    assert 0.3 < chosen.report.explained < 1 and chosen.report.n_rows == 5 * 297


def test_a_forest_keeps_an_input_where_none_stands_out():
    alone = [Trace(np.random.default_rng(seed).uniform(size=(30, 1)), np.zeros((30, 1))) for seed in range(3)]
    assert select(alone, SensorSettings(selection="forest", lags=1)).selected.tolist() == [[True]]


@pytest.mark.parametrize("name", SELECTIONS)
def test_too_short_traces_are_refused(name):
    with pytest.raises(ValueError, match="no trace is longer than 8 steps"):
        select([Trace(np.eye(4), np.eye(4))], SensorSettings(selection=name))
