"""Our numbers beside the paper's, and what follows, by rules that are stated in the report (`RULES`).

Where no paper tells of a task there are our numbers alone, and no verdicts.
"""

from typing import NamedTuple

import numpy as np

from qboot.study.analysis import sizes
from qboot.study.analysis.gathering import gather
from qboot.study.analysis.measures import RUN_MEASURES, Sample
from qboot.study.analysis.printed import Conclusion, Result
from qboot.study.analysis.statistics import Comparison, Quartiles, mann_whitney, median_interval, quartiles
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

AGREES, DIFFERS, NOT_COMPARABLE = "agrees", "differs", "not comparable at this size"
NO_NUMBER, NO_DATA, NO_PAPER = "the paper prints no number", "not measured", "no paper tells of it"
MIN_RUNS = 5
SIGNIFICANCE = 0.05

RULES = (
    f"A number is compared when at least {MIN_RUNS} runs have it and the sizes that it depends on are at least the "
    "paper's. It agrees when the paper's value lies between our quartiles and, where the paper prints quartiles, "
    "our value lies between those too; otherwise it differs.",
    "A run that did not reach a score counts as infinitely late. When our median run did not reach it, and the runs "
    "were given less time than the paper's took, the number is not comparable.",
    f"A conclusion is about an order, so it needs full populations and full rollouts, at least {MIN_RUNS} runs, and "
    "some score above zero. It agrees when the Mann-Whitney test finds that order "
    f"(A12 > 0.5, p < {SIGNIFICANCE}); otherwise it differs.",
)
# An order of two methods can show in shorter runs too, but not with other populations or rollouts.
_NEEDED_FOR_ORDER = ("population", "n_steps")


class Row(NamedTuple):
    """A number of ours beside the paper's."""

    measure: str  # name in `RUN_MEASURES`
    printed: Result | None  # None without a paper
    unit: str
    n_runs: int
    value: float  # our median or mean, as the paper's; NaN when nothing was measured
    quartiles: Quartiles[float]
    interval: tuple[float, float]  # 95 % bootstrap interval of the median
    not_reached: int | None  # runs that did not reach the goal; None when it is no time
    verdict: str
    missing: list[str]  # why runs have no such number

    @property
    def statistic(self) -> str:
        """What `value` is, "median" or "mean"."""
        return self.printed.statistic if self.printed else "median"


class Finding(NamedTuple):
    """A conclusion of the paper tested on our runs."""

    conclusion: Conclusion
    n_runs: int
    medians: tuple[float, float]  # of the greater and of the smaller; NaN when nothing was measured
    comparison: Comparison
    verdict: str


def rows(some: list[Run[RunSettings]]) -> list[Row]:
    """The paper's numbers of one task, each with ours; without a paper, all that is measured.

    Args:
        some: runs of one task, at least one.
    """
    task = task_of(some[0])
    if task.paper is None:
        return [_row(measure, None, some) for measure in RUN_MEASURES]
    return [_row(result.measure, result, some) for result in task.paper().results]


def findings(some: list[Run[RunSettings]]) -> list[Finding]:
    """The paper's conclusions on one task, each tested on `some` runs of it, at least one; none without a paper."""
    task = task_of(some[0])
    return [_finding(conclusion, some) for conclusion in task.paper().conclusions] if task.paper else []


def judge(result: Result | None, sample: Sample, n_runs: int, has_sizes: bool) -> str:
    """The verdict on a number, by the first two of `RULES`."""
    if not n_runs:
        return NO_DATA
    if result is None:
        return NO_PAPER
    if result.value is None:
        return NO_NUMBER
    ours = quartiles(sample.values)
    value = _central(result.statistic, sample)
    too_short = np.isinf(value) and sample.given < result.value
    if n_runs < MIN_RUNS or not has_sizes or too_short:
        return NOT_COMPARABLE
    low = -np.inf if result.lower is None else result.lower
    high = np.inf if result.upper is None else result.upper
    agrees = ours.lower <= result.value <= ours.upper and low <= value <= high
    return AGREES if agrees else DIFFERS


def judge_order(comparison: Comparison, top: float, n_runs: int, has_sizes: bool) -> str:
    """The verdict on a conclusion, by the last of `RULES`; `top` is the greatest score that any run had."""
    if not n_runs:
        return NO_DATA
    if n_runs < MIN_RUNS or not has_sizes or top <= 0:
        return NOT_COMPARABLE
    return AGREES if comparison.a12 > 0.5 and comparison.p_value < SIGNIFICANCE else DIFFERS


def has_sizes(some: list[Run[RunSettings]], needs: tuple[str, ...]) -> bool:
    """Whether all runs (at least one, of one task) are at least as large as the paper's in all that is named."""
    needed = sizes.of_paper(task_of(some[0]))
    return bool(needed) and all(sizes.of_run(run)[name] >= needed[name] for run in some for name in needs)


def _row(name: str, printed: Result | None, some: list[Run[RunSettings]]) -> Row:
    measure = RUN_MEASURES[name]
    gathered = gather(some, measure.read)
    found, missing = list(gathered.found.values()), list(gathered.missing.values())
    if not found:
        nothing = Quartiles(np.nan, np.nan, np.nan)
        return Row(name, printed, measure.unit, 0, np.nan, nothing, (np.nan, np.nan), None, NO_DATA, missing)
    sample = Sample.join(found)
    return Row(
        measure=name,
        printed=printed,
        unit=measure.unit,
        n_runs=len(found),
        value=_central(printed.statistic if printed else "median", sample),
        quartiles=Quartiles(*map(float, quartiles(sample.values))),
        interval=median_interval(sample.values),
        not_reached=int(np.isinf(sample.values).sum()) if np.isfinite(sample.given) else None,
        verdict=judge(printed, sample, len(found), has_sizes(some, measure.needs)),
        missing=missing,
    )


def _finding(conclusion: Conclusion, some: list[Run[RunSettings]]) -> Finding:
    sides = conclusion.greater, conclusion.smaller
    greater, smaller = (gather(some, RUN_MEASURES[name].read).found for name in sides)
    both = [run for run in greater if run in smaller]
    if not both:
        return Finding(conclusion, 0, (np.nan, np.nan), Comparison(np.nan, np.nan), NO_DATA)
    first, second = (np.concatenate([of[run].values for run in both]) for of in (greater, smaller))
    comparison = mann_whitney(first, second)
    top = float(max(first.max(), second.max()))
    verdict = judge_order(comparison, top, len(both), has_sizes(some, _NEEDED_FOR_ORDER))
    return Finding(conclusion, len(both), (float(np.median(first)), float(np.median(second))), comparison, verdict)


def _central(statistic: str, sample: Sample) -> float:
    return float(np.mean(sample.values) if statistic == "mean" else np.median(sample.values))
