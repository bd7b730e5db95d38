"""What runs scored: learning curves and scores in new domains, read from their folders.

`METHODS` are ER (evolution, the paper's "evolutionary robotics"), QL (Q-learning with what was extracted) and
ER+transfer (evolution from the source's Pareto front).
"""

from typing import NamedTuple

import jax
import numpy as np

from qboot.study.store.artifacts import read_columns, task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import AnyRun, Run
from qboot.study.store.settings import RunSettings

METHODS = ("QL", "ER", "ER+transfer")
# File and columns of a method's learning on the source set.
_SOURCE = {"ER": ("history.csv", "episodes", "best"), "QL": ("qlearning.csv", "episode", "score")}


class Curve(NamedTuple):
    """Scores of one run as it learns."""

    episodes: np.ndarray  # (K,) policies evaluated so far, increasing
    scores: np.ndarray  # (K,) best of the population (ER), or score of the episode (QL)


def columns(run: AnyRun, file: str, *names: str) -> list[np.ndarray]:
    """Columns (K,) of a CSV file of a run: numbers, or text where they are none.

    Raises:
        RunError: if the file or a column is missing, or has no rows.
    """
    found = read_columns(run, file)
    for name in names:
        if not found.get(name):
            raise RunError(f"{run.file(file)} has no values {name!r}: it is not of this version")
    return [_parsed(found[name]) for name in names]


def source_curve(run: AnyRun, method: str) -> Curve:
    """Learning on the source set by "ER" or "QL" (figures 6 and 14)."""
    return Curve(*columns(run, *_SOURCE[method]))


def target_curve(run: Run[RunSettings], method: str) -> Curve:
    """Learning on the target set by one of METHODS (figures 9 and 16)."""
    methods, episodes, scores = columns(run, "transfer.csv", "method", "episodes", "score")
    rows = methods == method
    if not rows.any():
        raise RunError(f"{run.file('transfer.csv')} has no rows of {method}: delete it and run transfer again")
    curve = Curve(episodes[rows], scores[rows])
    return curve if method == "QL" else to_the_end(run, curve)


def to_the_end(run: Run[RunSettings], curve: Curve) -> Curve:
    """The curve of an evolution on the target set, level from where it had the top score for good and was over, to the
    last of the generations that it was given; others as they are.
    """
    settings = run.settings
    missing = settings.target_generations + 1 - len(curve.scores)
    has_top = curve.scores[-1:].max(initial=0.0) >= top_score(run, "target")
    if missing <= 0 or not has_top or not settings.evolution.keeps_best:
        return curve
    end = curve.episodes[-1] + missing * settings.evolution.population
    return Curve(np.append(curve.episodes, end), np.append(curve.scores, curve.scores[-1]))


def generalisation(run: Run[RunSettings], method: str) -> float:
    """Score on the target set without learning there, summed over its domains, of "ER" or "QL" (figures 8 and 15)."""
    methods, scores = columns(run, "generalisation.csv", "method", "score")
    return float(scores[methods == method].sum())


def score_at_the_end(scores: np.ndarray) -> float:
    """Mean of the last hundred scores (K,), or of all where there are fewer; exploration included."""
    return float(scores[-100:].mean())


def top_score(run: AnyRun, domains: str) -> float:
    """The greatest score possible on the "source" or "target" set of a run."""
    task = task_of(run)
    some = {"source": task.source_domains, "target": task.target_domains}[domains](run.settings.source)
    return float(task.max_score_per_domain * len(jax.tree.leaves(some)[0]))


def moving_mean(curve: Curve, window: int) -> Curve:
    """Scores as means over the last `window` entries; over all that there are at the start."""
    sums = np.concatenate([[0.0], np.cumsum(curve.scores)])
    ends = np.arange(1, len(curve.scores) + 1)
    starts = np.maximum(ends - window, 0)
    return Curve(curve.episodes, (sums[ends] - sums[starts]) / (ends - starts))


def common_grid(curves: list[Curve], points: int = 400) -> np.ndarray:
    """Episodes (G,), evenly spaced in their logarithm, from the earliest entry to where the shortest curve ends."""
    first = min(curve.episodes[0] for curve in curves)
    last = min(curve.episodes[-1] for curve in curves)
    return np.unique(np.rint(np.geomspace(first, max(first, last), points)))


def _parsed(values: list[str]) -> np.ndarray:
    try:
        return np.array(values, float)
    except ValueError:
        return np.array(values)
