"""Relevant sensors by lasso and majority vote (paper, section IV-D).

For each sensor a lasso predicts its next value from all sensors at the last mu steps. An input is kept when more than
half of the models use it. Millions of steps enter through their Gram matrix alone, accumulated trace by trace.
Shape letters: S sensors, L lags, Q = L S inputs; input q = (lag - 1) S + sensor, lag 1 being the step before.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

RULES = ("bic", "fixed")
# Steps whose products are added in single precision before they join the sum in double precision.
CHUNK = 4096


@dataclass(frozen=True)
class SensorSettings:
    """How sensors are selected."""

    lags: int = 8
    """mu: past observations that may predict the next one (appendix B)."""
    rule: str = "bic"
    """What decides the strength of the penalty: bic (least Bayesian information criterion), or fixed (alpha)."""
    steps_per_sample: float = 50.0
    """bic: neighbouring steps tell the same; so many of them count as one independent sample."""
    alpha: float = 0.001
    """fixed: the penalty, in units of correlation."""

    def __post_init__(self):
        """Reject settings without a meaning."""
        if self.lags < 1:
            raise ValueError(f"lags is {self.lags}: at least 1 past observation is needed")
        if self.rule not in RULES:
            raise ValueError(f"unknown rule {self.rule!r}: choose one of {', '.join(RULES)}")
        if self.steps_per_sample <= 0 or self.alpha <= 0:
            raise ValueError("steps_per_sample and alpha must be positive")


class SensorVotes(NamedTuple):
    """The models behind a selection."""

    kept: np.ndarray  # (targets, L, S) bool, inputs with a weight; a constant sensor has no model
    targets: np.ndarray  # (targets,) int, the sensor that each model predicts
    alphas: np.ndarray  # (targets,) penalty of each model, in units of correlation
    n_steps: int  # steps predicted, in all traces


class Moments(NamedTuple):
    """Sums over all steps: everything a linear model can learn from them."""

    n_steps: int
    products: np.ndarray  # (1 + Q + S, 1 + Q + S) of [1, inputs, targets]


def select_sensors(
    observations: Iterable[np.ndarray], lags: int, settings: SensorSettings | None = None
) -> np.ndarray:
    """The inputs kept by a majority of the lasso models.

    Args:
        observations: one (n_h, n_s) array per trace; traces of at most `lags` steps tell nothing.
        lags: past observations that may be kept.
        settings: what decides the strength of the penalty; its own `lags` is not used.

    Returns:
        (lags, n_s) bool, row 0 being the step before. At least one input is kept: if no input has a majority,
        those with the most votes.

    Raises:
        ValueError: if no trace is long enough, traces differ in their sensors, or no sensor ever changes.
    """
    return majority(sensor_votes(observations, lags, settings or SensorSettings()).kept)


def majority(kept: np.ndarray) -> np.ndarray:
    """Inputs (L, S) that more than half of the models `kept` (targets, L, S) use, else those with the most votes."""
    votes = kept.sum(axis=0)
    winners = votes > len(kept) / 2
    return winners if winners.any() else votes == votes.max()


def sensor_votes(observations: Iterable[np.ndarray], lags: int, settings: SensorSettings) -> SensorVotes:
    """One lasso per sensor that changes; raises as `select_sensors` does."""
    moments = accumulate(observations, lags)
    n_sensors = (moments.products.shape[0] - 1) // (lags + 1)
    correlation, varies = _correlations(moments)
    n_inputs = lags * n_sensors
    inputs = np.flatnonzero(varies[:n_inputs])
    targets = np.flatnonzero(varies[n_inputs:])
    if not len(targets) or not len(inputs):
        raise ValueError("no sensor ever changes in these traces: there is nothing to predict")
    gram = correlation[np.ix_(inputs, inputs)]
    kept = np.zeros((len(targets), n_inputs), bool)
    alphas = np.zeros(len(targets))
    for model, target in enumerate(targets):
        weights, alphas[model] = _lasso(gram, correlation[inputs, n_inputs + target], moments.n_steps, settings)
        kept[model, inputs] = weights != 0
    return SensorVotes(kept.reshape(-1, lags, n_sensors), targets, alphas, moments.n_steps)


def accumulate(observations: Iterable[np.ndarray], lags: int) -> Moments:
    """Moments of inputs and targets over all traces; raises ValueError as `select_sensors` does."""
    if lags < 1:
        raise ValueError(f"lags is {lags}: at least 1 past observation is needed")
    n_steps, products = 0, None
    for trace in observations:
        trace = np.asarray(trace, np.float32)
        if trace.ndim != 2:
            raise ValueError(f"a trace must have shape (steps, sensors), not {trace.shape}")
        size = 1 + (lags + 1) * trace.shape[1]
        if products is None:
            products = np.zeros((size, size))
        if products.shape[0] != size:
            raise ValueError("traces differ in their number of sensors")
        for start in range(0, len(trace) - lags, CHUNK):
            piece = trace[start : start + CHUNK + lags]
            n_rows = len(piece) - lags
            # Column blocks: the constant, the observations 1 to `lags` steps ago, the observation to predict.
            past = [piece[lags - lag : lags - lag + n_rows] for lag in range(1, lags + 1)]
            rows = np.concatenate([np.ones((n_rows, 1), np.float32), *past, piece[lags:]], axis=1)
            products += rows.T @ rows
            n_steps += n_rows
    if not n_steps:
        raise ValueError(f"no trace is longer than {lags} steps: there is nothing to predict")
    return Moments(n_steps, products)


def _correlations(moments: Moments) -> tuple[np.ndarray, np.ndarray]:
    """Correlation matrix (Q + S, Q + S) of inputs and targets, and which of them vary at all."""
    mean = moments.products[0, 1:] / moments.n_steps
    covariance = moments.products[1:, 1:] / moments.n_steps - np.outer(mean, mean)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    varies = deviation > 1e-4  # below single precision's noise of a constant
    scale = np.where(varies, deviation, 1.0)
    return covariance / np.outer(scale, scale), varies


def _lasso(
    gram: np.ndarray, target: np.ndarray, n_steps: int, settings: SensorSettings
) -> tuple[np.ndarray, float]:
    """Weights and penalty of the lasso chosen by the rule; never without any weight."""
    from sklearn.linear_model import lars_path_gram

    alphas, _, path = lars_path_gram(Xy=target, Gram=gram, n_samples=1, method="lasso")
    if settings.rule == "fixed":
        after = np.flatnonzero(alphas <= settings.alpha)
        # Weights change linearly between two knots of the path, and keep their support.
        choice = int(after[0]) if len(after) else len(alphas) - 1
    else:
        n_samples = max(n_steps / settings.steps_per_sample, 2.0)
        residual = 1.0 - 2.0 * target @ path + np.einsum("qk,qp,pk->k", path, gram, path)
        n_weights = (path != 0).sum(axis=0)
        criterion = n_samples * np.log(np.maximum(residual, 1e-12)) + n_weights * np.log(n_samples)
        choice = int(np.argmin(criterion))
    choice = max(choice, 1)
    return path[:, choice], float(alphas[choice])
