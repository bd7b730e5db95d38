"""How much a small random forest needs each input to predict the next observation (Breiman, 2001).

Shape letters: S sensors, L lags, n rows.
"""

from typing import NamedTuple

import numpy as np

# Rows drawn from all traces: half of them to fit, half of them to ask what is needed.
MAX_ROWS = 4_000
TREES = 30
MIN_SAMPLES_LEAF = 5
# Times that each input is shuffled.
REPEATS = 3


class Importance(NamedTuple):
    """What a forest needs."""

    drops: np.ndarray  # (L, S) loss of explained variance (R^2, mean over the sensors) when an input is shuffled
    explained: float  # share of the variance that the forest explains where it was not fitted
    n_rows: int


def permutation_importance(observations: list[np.ndarray], lags: int) -> Importance:
    """Importance of all inputs o(t-1) .. o(t-L) for a forest that predicts o(t), all sensors at once.

    Args:
        observations: traces (T, S); those not longer than `lags` are skipped.
        lags: L, >= 1.

    Raises:
        ValueError: if no trace is long enough, or no sensor ever varies.
    """
    from sklearn.ensemble import RandomForestRegressor  # takes a second to import: only those who fit pay
    from sklearn.inspection import permutation_importance as importance_of

    # The choice of rows and the forest draw from streams of their own: the data alone decide.
    drawn = np.random.default_rng(0)
    inputs, targets = _rows(observations, lags, drawn)
    varies = targets.std(axis=0) > 0
    if len(targets) < 2 or not varies.any():
        raise ValueError("no sensor ever varies: observations of at least one must differ.")
    targets = (targets - targets.mean(axis=0))[:, varies] / targets.std(axis=0)[varies]
    targets = targets[:, 0] if targets.shape[1] == 1 else targets  # as scikit-learn wants it
    fitted, asked = np.array_split(drawn.permutation(len(targets)), 2)
    forest = RandomForestRegressor(TREES, min_samples_leaf=MIN_SAMPLES_LEAF, max_features="sqrt", random_state=0)
    forest.fit(inputs[fitted], targets[fitted])
    errors = "neg_mean_squared_error"  # of standardised targets: explained variance but for a constant
    found = importance_of(forest, inputs[asked], targets[asked], scoring=errors, n_repeats=REPEATS, random_state=0)
    unexplained = np.mean(np.square(forest.predict(inputs[asked]).reshape(targets[asked].shape) - targets[asked]))
    return Importance(found.importances_mean.reshape(lags, -1), float(1 - unexplained), len(targets))


def _rows(observations: list[np.ndarray], lags: int, drawn: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """At most MAX_ROWS inputs (n, L S), lag by lag, and targets (n, S), any of all rows alike."""
    counts = np.array([max(0, len(trace) - lags) for trace in observations])
    if not counts.sum():
        raise ValueError(f"no trace is longer than {lags} steps: use longer rollouts or fewer lags.")
    chosen = np.sort(drawn.permutation(counts.sum())[:MAX_ROWS])
    ends = np.cumsum(counts)
    places = np.searchsorted(ends, chosen, side="right")
    times = chosen - (ends - counts)[places] + lags
    inputs = [
        np.concatenate([observations[i][t - k] for k in range(1, lags + 1)]) for i, t in zip(places, times, strict=True)
    ]
    targets = [observations[i][t] for i, t in zip(places, times, strict=True)]
    return np.asarray(inputs, np.float64), np.asarray(targets, np.float64)
