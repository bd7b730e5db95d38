"""Choice of the inputs that tell the state, by methods with names: lasso models and a majority vote (section IV-D).

Another method is a function (traces, settings) -> Selection, and a row of SELECTIONS.

Shape letters: S sensors, L lags (the paper's mu), T steps, P inputs that vary (L S of them at most).
Only sums of products over all rows are kept, never the rows, so any number of traces fits in memory.

How many inputs survive is decided by how strong the lasso's penalty is. A robot's sensors are predicted best by their
own last values. So a strong penalty makes every sensor vote for itself alone, and no input gets a majority; a weak one
keeps nearly every input. `docs/fidelity.md` has the counts, and why the default is the plain criterion.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from qboot.extraction import forest
from qboot.extraction.threads import one_thread
from qboot.extraction.traces import Trace

MOMENTS = ("steps", "decisions")
RULES = ("bic", "bic_traces", "bic_rows", "fixed")
# Rows multiplied at a time.
CHUNK = 4096
# A column is constant, but for rounding, when its variance is below this share of its mean square.
CONSTANT = 1e-10
# Variance of the measurement noise supposed on every input, as a share of its own: some sensors are exact sums of
# others, and without noise the lasso's path through them is not defined.
NOISE = 1e-4
# Correlations with a target are moved by up to this, at random. Equal inputs, such as the place of a block that rests,
# at all lags, would enter the path at once; least angle regression takes one at a time, and where they tie, rounding
# decides which, and the path may end long before its penalty is small.
JITTER = 1e-10
# Weights of standardised inputs below this are zeros with rounding errors.
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class SensorSettings:
    """How inputs are chosen. Raises `ValueError` when a value lies outside the range given under it."""

    selection: str = "lasso"
    """Name of the method."""

    lags: int = 8
    """mu: past observations that inputs are chosen from, >= 1."""

    moments: str = "steps"
    """Of what the traces are made that the models are fitted on: all "steps", as the paper has it, or those at which
    an action begins, the "decisions", by which some learners count their lags."""

    rule: str = "bic_rows"
    """Penalty by BIC for `sample_size` observations ("bic"), for as many as there are traces ("bic_traces") or rows
    ("bic_rows"), or the penalty `alpha` ("fixed")."""

    sample_size: int = 30_000
    """Observations that the rule "bic" credits the traces with, >= 2; more of them keep more inputs."""

    alpha: float = 0.001
    """Lasso penalty of the rule "fixed", on standardised inputs and targets (a correlation), in (0, 1)."""

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        for name, table in (("selection", SELECTIONS), ("rule", RULES), ("moments", MOMENTS)):
            if getattr(self, name) not in table:
                raise ValueError(f"{name} is {getattr(self, name)!r}: it must be one of {', '.join(table)}")
        for name, least in (("lags", 1), ("sample_size", 2)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least {least}")
        if not 0 < self.alpha < 1:
            raise ValueError(f"alpha is {self.alpha}: it must lie between 0 and 1")


class Sums(NamedTuple):
    """Sums over the rows (1, y(t), o(t-1), .. o(t-L)) of all traces; y is what is predicted: o, or commands."""

    products: np.ndarray  # (1 + M + L S, 1 + M + L S) float64, sum of outer products
    n_traces: int
    n_rows: int
    n_targets: int  # M


class SensorVotes(NamedTuple):
    """What each sensor's model keeps. A sensor that never varies has no model and does not vote.

    Where commands are predicted, the first axes have the length E, and are effectors.
    """

    kept: np.ndarray  # (S, L, S) bool: to predict sensor j, its model keeps sensor l at lag k + 1
    alphas: np.ndarray  # (S,) penalty chosen, NaN without a model
    explained: np.ndarray  # (S,) share of the variance that the model explains, NaN without a model
    n_traces: int  # long enough to be used
    n_rows: int


class Selection(NamedTuple):
    """The inputs chosen, and what to report of the choice."""

    selected: np.ndarray  # (L, S) bool; row k is the observation o(t - k - 1)
    report: Any  # a named tuple of arrays, to be stored with them


def select(traces: Iterable[Trace], settings: SensorSettings) -> Selection:
    """Inputs chosen from learning traces by the method that the settings name; errors as `sensor_votes`."""
    return SELECTIONS[settings.selection](traces, settings)


def select_sensors(observations: Iterable[np.ndarray], lags: int, settings: SensorSettings | None = None) -> np.ndarray:
    """Inputs that more than half of the sensors' models keep, (lags, S) bool; row k is the observation o(t - k - 1).

    Arguments and errors are those of `sensor_votes`; for a vote without a majority see `majority`.
    """
    return majority(sensor_votes(observations, lags, settings).kept)


def majority(kept: np.ndarray) -> np.ndarray:
    """Inputs kept by more than half of the models that keep any; (L, S) bool from (S, L, S).

    When no input has a majority, those with the most votes are returned: a learner needs at least one.

    Raises:
        ValueError: if no model keeps anything.
    """
    votes = kept.sum(axis=0)
    n_voters = kept.any(axis=(1, 2)).sum()
    if not n_voters:
        raise ValueError("there is no vote to count: no sensor has a model.")
    elected = 2 * votes > n_voters
    return elected if elected.any() else votes == votes.max()


@one_thread()
def sensor_votes(observations: Iterable[np.ndarray], lags: int, settings: SensorSettings | None = None) -> SensorVotes:
    """A lasso model for every sensor: o_j(t) from all sensors at t-1 .. t-L, all standardised.

    Every model keeps at least one input, the one that correlates best with its target.

    Args:
        observations: traces (T, S), of different lengths; those not longer than `lags` are skipped.
        lags: L, >= 1.
        settings: the rule for the penalty, by default `SensorSettings()`; its `lags` is not used here.

    Raises:
        ValueError: if traces are not finite or of different S, none is long enough, or no sensor ever varies.
    """
    return _votes(sum_rows(observations, lags), lags, settings or SensorSettings(), "sensor")


def effector_votes(traces: Iterable[Trace], lags: int, settings: SensorSettings | None = None) -> SensorVotes:
    """A lasso model for every effector: u_j(t) from all sensors at t .. t-L+1, all standardised.

    Arguments, errors and the rest as `sensor_votes`, with effectors in the place of the sensors that are predicted.
    """
    # A command follows the observation of its own step: the latest that a decision sees, lag 1.
    later = ((np.concatenate([trace.commands[:1], trace.commands[:-1]]), trace.observations) for trace in traces)
    return _votes(_sum_pairs(later, lags), lags, settings or SensorSettings(), "effector")


def _votes(sums: Sums, lags: int, settings: SensorSettings, kind: str) -> SensorVotes:
    """The models of all targets that vary; they are of a `kind`, sensor or effector."""
    correlations, varies = standardise(sums)
    n_targets = sums.n_targets
    n_sensors = (len(correlations) - n_targets) // lags
    targets = np.flatnonzero(varies[:n_targets])
    inputs = n_targets + np.flatnonzero(varies[n_targets:])
    for name, some in ((kind, targets), ("sensor", inputs)):
        if not len(some):
            raise ValueError(
                f"no {name} ever varies in the {sums.n_rows:,} timesteps that come after {lags} others of their "
                "rollout: use longer rollouts, fewer lags, or a task where it does."
            )
    gram = correlations[np.ix_(inputs, inputs)] + NOISE * np.eye(len(inputs))

    kept = np.zeros((n_targets, lags * n_sensors), bool)
    alphas, explained = np.full((2, n_targets), np.nan)
    for j in targets:
        weights, alphas[j], explained[j] = fit_lasso(gram, correlations[inputs, j], settings, sums)
        kept[j, inputs - n_targets] = weights != 0
    return SensorVotes(kept.reshape(n_targets, lags, n_sensors), alphas, explained, sums.n_traces, sums.n_rows)


def sum_rows(observations: Iterable[np.ndarray], lags: int) -> Sums:
    """The sums over all traces longer than `lags`; errors as `sensor_votes`."""
    return _sum_pairs(((trace, trace) for trace in observations), lags)


@one_thread()
def _sum_pairs(traces: Iterable[tuple[np.ndarray, np.ndarray]], lags: int) -> Sums:
    """The sums of targets (T, M) and observations (T, S); errors as `sensor_votes`."""
    if lags < 1:
        raise ValueError(f"lags must be at least 1, got {lags}.")
    products: np.ndarray = np.zeros(())
    n_traces, n_rows, n_sensors, n_targets = 0, 0, None, 0
    for targets, trace in traces:
        targets, trace = np.asarray(targets, np.float64), np.asarray(trace, np.float64)
        n_sensors, n_targets = n_sensors or trace.shape[-1], targets.shape[-1]
        if trace.ndim != 2 or trace.shape[1] != n_sensors:
            raise ValueError(f"observations must be (steps, {n_sensors} sensors) in all traces, got {trace.shape}.")
        if not np.isfinite(trace).all() or not np.isfinite(targets).all():
            raise ValueError("observations must be finite: a trace holds NaN or infinite values.")
        if len(trace) <= lags:
            continue
        for first in range(lags, len(trace), CHUNK):
            last = min(first + CHUNK, len(trace))
            shifted = [trace[first - k : last - k] for k in range(1, lags + 1)]
            rows = np.hstack([np.ones((last - first, 1)), targets[first:last], *shifted])
            products = products + rows.T @ rows
        n_traces, n_rows = n_traces + 1, n_rows + len(trace) - lags
    if not n_traces:
        raise ValueError(f"no trace is longer than {lags} steps: use longer rollouts or fewer lags.")
    return Sums(products, n_traces, n_rows, n_targets)


def standardise(sums: Sums) -> tuple[np.ndarray, np.ndarray]:
    """Correlations between the columns y(t), o(t-1), .. o(t-L), and which columns vary; 0 for those that do not."""
    square = np.diag(sums.products)[1:] / sums.n_rows
    mean = sums.products[0, 1:] / sums.n_rows
    covariance = sums.products[1:, 1:] / sums.n_rows - np.outer(mean, mean)
    varies = np.diag(covariance) > CONSTANT * square
    unit = np.sqrt(np.where(varies, np.diag(covariance), 1.0))
    return covariance / np.outer(unit, unit) * np.outer(varies, varies), varies


def fit_lasso(
    gram: np.ndarray, correlation: np.ndarray, settings: SensorSettings, sums: Sums
) -> tuple[np.ndarray, float, float]:
    """The lasso model of one target at the penalty that the rule chooses.

    Args:
        gram: (P, P) correlations between the inputs.
        correlation: (P,) of the inputs with the target.
        settings: the rule.
        sums: where the inputs come from, for the rules that count.

    Returns:
        Weights (P,), not all zero, the penalty, and the share of the target's variance explained.
    """
    from sklearn.linear_model import lars_path_gram  # takes a second to import: only those who fit pay

    least = settings.alpha if settings.rule == "fixed" else 0.0
    apart = correlation + JITTER * np.random.default_rng(0).uniform(-1.0, 1.0, len(correlation))
    alphas, _, path = lars_path_gram(apart, gram, n_samples=1, method="lasso", alpha_min=least, max_iter=20 * len(gram))
    path[np.abs(path) < NEGLIGIBLE] = 0.0
    unexplained = 1 - 2 * correlation @ path + np.einsum("ip,ij,jp->p", path, gram, path)
    if settings.rule == "fixed":
        chosen = len(alphas) - 1
    else:
        counts = {"bic": settings.sample_size, "bic_traces": sums.n_traces, "bic_rows": sums.n_rows}
        chosen = _least_bic(path, unexplained, counts[settings.rule])
    weights = path[:, chosen]
    if not weights.any():
        best = np.abs(correlation).argmax()
        weights = np.where(np.arange(len(gram)) == best, correlation, 0.0)
        unexplained[chosen] = 1 - correlation[best] ** 2
    return weights, alphas[chosen], 1 - unexplained[chosen]


def _least_bic(path: np.ndarray, unexplained: np.ndarray, n: int) -> int:
    """Place on the path (P, places) of the least Bayesian information criterion for n observations."""
    misfit = n * np.log(np.maximum(unexplained, NEGLIGIBLE))
    return int(np.argmin(misfit + np.log(n) * (path != 0).sum(axis=0)))


def _lasso(traces: Iterable[Trace], settings: SensorSettings) -> Selection:
    votes = sensor_votes((trace.observations for trace in traces), settings.lags, settings)
    return Selection(majority(votes.kept), votes)


def _lasso_of_commands(traces: Iterable[Trace], settings: SensorSettings) -> Selection:
    votes = effector_votes(traces, settings.lags, settings)
    return Selection(majority(votes.kept), votes)


def _forest(traces: Iterable[Trace], settings: SensorSettings) -> Selection:
    importance = forest.permutation_importance([trace.observations for trace in traces], settings.lags)
    drops = importance.drops
    elected = drops > drops.mean()
    return Selection(elected if elected.any() else drops == drops.max(), importance)


SELECTIONS: dict[str, Callable[[Iterable[Trace], SensorSettings], Selection]] = {
    "lasso": _lasso,
    "lasso_of_commands": _lasso_of_commands,
    "forest": _forest,
}
"""(traces, settings) -> a selection with at least one input; `settings.lags` rows."""
