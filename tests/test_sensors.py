import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import Lasso

from qboot.extraction import sensors
from qboot.extraction.sensors import (
    NOISE,
    RULES,
    SELECTIONS,
    SensorSettings,
    majority,
    select,
    select_sensors,
    sensor_votes,
    sum_rows,
)
from qboot.extraction.traces import Trace

LAGS = 3


def driven_traces(n_traces, n_steps, seed):
    """Four sensors: two slow independent ones, one that follows the first two steps later, one that never varies."""
    random = np.random.default_rng(seed)
    traces = []
    for _ in range(n_traces):
        noise = random.normal(size=(n_steps, 3))
        trace = np.zeros((n_steps, 4))
        for t in range(2, n_steps):
            trace[t, 0] = 0.8 * trace[t - 1, 0] + noise[t, 0]
            trace[t, 1] = 0.8 * trace[t - 1, 1] + noise[t, 1]
            trace[t, 2] = trace[t - 2, 0] + 0.1 * noise[t, 2]
        trace[:, 3] = 0.7
        traces.append(trace)
    return traces


@pytest.fixture(scope="module")
def traces():
    return driven_traces(6, 400, 0)


def design_matrix(traces, lags):
    """Inputs and targets of all rows, standardised, written as loops."""
    inputs, targets = [], []
    for trace in traces:
        for t in range(lags, len(trace)):
            inputs.append(np.concatenate([trace[t - k] for k in range(1, lags + 1)]))
            targets.append(trace[t])
    return [(x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-9) for x in (np.array(inputs), np.array(targets))]


def test_sums_are_those_of_the_design_matrix(traces, monkeypatch):
    monkeypatch.setattr(sensors, "CHUNK", 57)
    sums = sum_rows(traces, LAGS)
    rows = [
        np.concatenate([[1], *(trace[t - k] for k in range(LAGS + 1))])
        for trace in traces
        for t in range(LAGS, len(trace))
    ]
    np.testing.assert_allclose(sums.products, np.transpose(rows) @ rows, atol=1e-9)
    assert (sums.n_traces, sums.n_rows) == (6, 6 * 397)


@pytest.mark.parametrize("alpha", [0.3, 0.05, 0.01, 0.002])
def test_fixed_penalty_keeps_what_an_ordinary_lasso_keeps(traces, alpha):
    inputs, targets = design_matrix(traces, LAGS)
    n = len(inputs)
    # Rows that add the supposed noise to the inputs' covariance, and nothing else.
    noise = np.sqrt(n * NOISE) * np.eye(inputs.shape[1])
    votes = sensor_votes(traces, LAGS, SensorSettings(rule="fixed", alpha=alpha))
    for j in range(3):
        lasso = Lasso(alpha=alpha * n / (n + len(noise)), fit_intercept=False, tol=1e-12, max_iter=100_000)
        lasso.fit(np.vstack([inputs, noise]), np.append(targets[:, j], np.zeros(len(noise))))
        np.testing.assert_array_equal(votes.kept[j].ravel(), lasso.coef_ != 0)
        assert votes.alphas[j] == pytest.approx(alpha)
        residual = ((targets[:, j] - inputs @ lasso.coef_) ** 2).mean() + NOISE * (lasso.coef_**2).sum()
        assert votes.explained[j] == pytest.approx(1 - residual, abs=1e-6)


def test_votes_find_what_drives_each_sensor(traces):
    votes = sensor_votes(traces, LAGS, SensorSettings(rule="bic_rows"))
    for target, lag, sensor in ((0, 1, 0), (1, 1, 1), (2, 2, 0)):
        assert votes.kept[target, lag - 1, sensor]
    assert not votes.kept[1, :, [0, 2]].any()
    assert not votes.kept[3].any(), "a constant sensor has no model"
    assert not votes.kept[:, :, 3].any(), "and predicts nothing"
    assert np.isnan(votes.alphas).tolist() == np.isnan(votes.explained).tolist() == [False, False, False, True]
    assert (votes.explained[:3] > [0.5, 0.5, 0.95]).all()


def test_larger_samples_keep_more(traces):
    counts = [
        sensor_votes(traces, LAGS, SensorSettings(rule="bic", sample_size=n)).kept.sum()
        for n in (2, 100, 10_000, 10_000_000)
    ]
    assert counts == sorted(counts)
    assert counts[0] >= 3, "every model keeps something"
    assert counts[0] < counts[-1]


@pytest.mark.parametrize("rule", RULES)
def test_order_of_traces_does_not_matter(traces, rule):
    settings = SensorSettings(rule=rule)
    selected = select_sensors(traces, LAGS, settings)
    assert (selected.shape, selected.dtype) == ((LAGS, 4), bool)
    np.testing.assert_array_equal(select_sensors(traces[::-1], LAGS, settings), selected)


@pytest.mark.parametrize("name", SELECTIONS)
def test_every_method_chooses_among_lags_and_sensors(traces, name):
    flow = [Trace(trace, trace[:, :2]) for trace in traces]
    selection = select(flow, SensorSettings(selection=name, lags=LAGS))
    assert (selection.selected.shape, selection.selected.dtype) == ((LAGS, 4), bool)
    assert selection.selected.any()
    assert all(isinstance(np.asarray(part), np.ndarray) for part in selection.report)


def test_the_lasso_is_the_default_method(traces):
    flow = [Trace(trace, trace[:, :2]) for trace in traces]
    selection = select(flow, SensorSettings(lags=LAGS))
    np.testing.assert_array_equal(selection.selected, select_sensors(traces, LAGS))
    np.testing.assert_array_equal(selection.report.kept, sensor_votes(traces, LAGS).kept)


def test_order_of_sensors_is_that_of_the_selection(traces):
    order = np.array([2, 3, 0, 1])
    selected = select_sensors(traces, LAGS)
    np.testing.assert_array_equal(select_sensors((trace[:, order] for trace in traces), LAGS), selected[:, order])


def test_units_of_the_sensors_do_not_matter(traces):
    scaled = [100 + trace * [1e-3, 1.0, 50.0, 1.0] for trace in traces]
    np.testing.assert_array_equal(select_sensors(scaled, LAGS), select_sensors(traces, LAGS))


def test_sensors_that_are_sums_of_others_are_no_obstacle(traces):
    doubled = [np.column_stack([trace, trace[:, 0] - trace[:, 1], trace[:, 0]]) for trace in traces]
    votes = sensor_votes(doubled, LAGS)
    assert (votes.explained[[0, 1, 2, 4, 5]] <= 1).all()
    assert votes.kept[[0, 1, 2, 4, 5]].any(axis=(1, 2)).all()


def blocks_at_rest(n_traces, seed):
    """A hand that comes nearer to a block: the block rests, all its lags are equal; the third is their difference."""
    random = np.random.default_rng(seed)
    traces = []
    for _ in range(n_traces):
        hand = np.cumsum(random.uniform(-0.02, 0.03, 60)) + random.uniform()
        block = np.full(60, random.uniform())
        traces.append(np.float32(np.stack([hand, block, block - hand], axis=1)).astype(float))
    return traces


def test_equal_inputs_do_not_end_the_path_of_the_lasso(monkeypatch):
    """Its criterion is the least of all penalties', by coordinate descent, which takes equal inputs as they come."""
    fits = []
    fit = sensors.fit_lasso

    def kept(gram, correlation, *rest):
        fits.append((gram, correlation, rest[-1].n_rows, *fit(gram, correlation, *rest)))
        return fits[-1][3:]

    monkeypatch.setattr(sensors, "fit_lasso", kept)
    sensor_votes(blocks_at_rest(20, 0), 8, SensorSettings())
    for gram, correlation, n_rows, weights, _, _ in fits:

        def criterion(some, gram=gram, correlation=correlation, n_rows=n_rows):
            unexplained = 1 - 2 * correlation @ some + some @ gram @ some
            return n_rows * np.log(unexplained) + np.log(n_rows) * np.count_nonzero(some)

        # The rows of a root of the matrix are data with these very correlations.
        rows = np.linalg.cholesky(gram).T
        target = np.linalg.solve(rows.T, correlation)
        others = [
            Lasso(alpha / len(rows), fit_intercept=False, tol=1e-12, max_iter=1_000_000).fit(rows, target).coef_
            for alpha in np.geomspace(1e-1, 1e-6, 26)
        ]
        assert criterion(weights) <= min(map(criterion, others)) + 1e-6


def test_short_traces_are_left_out(traces):
    short = [np.full((LAGS, 4), 5.0), np.zeros((0, 4))]
    votes = sensor_votes([*short, *traces], LAGS)
    assert votes.n_traces == len(traces)
    np.testing.assert_array_equal(votes.kept, sensor_votes(traces, LAGS).kept)


@given(st.integers(1, 7), st.integers(0, 2**31))
@settings(max_examples=50, deadline=None)
def test_majority_is_more_than_half_of_those_who_vote(n_voters, seed):
    kept = np.random.default_rng(seed).random((n_voters, 2, 3)) < 0.6
    kept[:, 0, 0] = True
    elected = majority(np.concatenate([kept, np.zeros((2, 2, 3), bool)]))
    for lag in range(2):
        for sensor in range(3):
            assert elected[lag, sensor] == (sum(kept[:, lag, sensor]) > n_voters / 2)


def test_without_a_majority_those_with_most_votes_are_kept():
    # Four sensors of which each predicts itself, and one predicts the second too.
    kept = np.zeros((4, 2, 4), bool)
    kept[np.arange(4), 0, np.arange(4)] = True
    kept[3, 0, 1] = True
    assert np.argwhere(majority(kept)).tolist() == [[0, 1]]
    with pytest.raises(ValueError, match="no vote"):
        majority(np.zeros((4, 2, 4), bool))


@pytest.mark.parametrize(
    ("observations", "lags", "message"),
    [
        ([np.zeros((9, 2))], 0, "lags"),
        ([np.zeros((9, 2))], 3, "no sensor ever varies in the 6 timesteps that come after 3 others"),
        ([np.eye(4)], 3, "no sensor ever varies in the 1 timesteps .*: use longer rollouts, fewer lags"),
        ([np.zeros((9, 2)), np.zeros((9, 3))], 3, "2 sensors"),
        ([np.zeros(9)], 3, "steps"),
        ([np.full((9, 2), np.nan)], 3, "finite"),
        ([np.zeros((3, 2))], 3, "no trace is longer than 3 steps"),
        ([], 3, "no trace is longer"),
    ],
)
def test_unusable_observations_are_refused(observations, lags, message):
    with pytest.raises(ValueError, match=message):
        select_sensors(observations, lags)


@pytest.mark.parametrize(
    "change",
    [{"lags": 0}, {"rule": "aic"}, {"sample_size": 1}, {"alpha": 0.0}, {"alpha": np.nan}, {"selection": "wish"}],
)
def test_settings_outside_their_range_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        SensorSettings(**change)


def test_sums_do_not_depend_on_the_threads_of_blas():
    """Split among two threads, these sums would be rounded differently."""
    from threadpoolctl import threadpool_limits

    observations = [np.random.default_rng(0).normal(size=(500, 13)) for _ in range(3)]
    found = []
    for n_threads in (1, 2, 4):
        with threadpool_limits(limits=n_threads):
            found.append(sensors.sum_rows(observations, 8).products.tobytes())
    assert len(set(found)) == 1
