"""Our numbers beside the paper's, and what follows, by rules that are stated in the report (`RULES`)."""

from typing import NamedTuple

import numpy as np

from qboot.study.analysis import paper, sizes
from qboot.study.analysis.curves import gather
from qboot.study.analysis.measures import MEASURES, Sample
from qboot.study.analysis.paper import Conclusion, Result
from qboot.study.analysis.statistics import Comparison, Quartiles, mann_whitney, median_interval, quartiles
from qboot.study.store.runs import Run

AGREES, DIFFERS, NOT_COMPARABLE = "agrees", "differs", "not comparable at this size"
NO_NUMBER, NO_DATA = "the paper prints no number", "not measured"
MIN_RUNS = 5
SIGNIFICANCE = 0.05

RULES = (
    f"A number is compared when at least {MIN_RUNS} runs have it and the sizes that it depends on are at least the "
    "paper's. It agrees when the paper's value lies between our quartiles and, where the paper prints quartiles, "
    "our value lies between those too; otherwise it differs.",
    "A run that did not reach a score counts as infinitely late. When our median run did not reach it, and the runs "
    "were given less time than the paper's took, the number is not comparable.",
    f"A conclusion is about an order, so it needs full populations and full tests, at least {MIN_RUNS} runs, and "
    "some score above zero. It agrees when the Mann-Whitney test finds that order "
    f"(A12 > 0.5, p < {SIGNIFICANCE}); otherwise it differs.",
)
# An order of two methods can show in shorter runs too, but not with other populations or tests.
_NEEDED_FOR_ORDER = ("population", "n_steps")


class Row(NamedTuple):
    """A number of ours beside the paper's."""

    result: Result
    unit: str
    n_runs: int
    value: float  # our median or mean, as the paper's; NaN when nothing was measured
    quartiles: Quartiles
    interval: tuple[float, float]  # 95 % bootstrap interval of the median
    not_reached: int | None  # runs that did not reach the goal; None when it is no time
    verdict: str
    missing: list[str]  # why runs have no such number


class Finding(NamedTuple):
    """A conclusion of the paper tested on our runs."""

    conclusion: Conclusion
    n_runs: int
    medians: tuple[float, float]  # of the greater and of the smaller; NaN when nothing was measured
    comparison: Comparison
    verdict: str


def rows(some: list[Run]) -> list[Row]:
    """The paper's numbers of one task, each with ours; `some` runs of it, at least one."""
    return [_row(result, some) for result in paper.RESULTS[some[0].settings.task]]


def findings(some: list[Run]) -> list[Finding]:
    """The paper's conclusions on one task, each tested on `some` runs of it, at least one."""
    return [_finding(conclusion, some) for conclusion in paper.CONCLUSIONS[some[0].settings.task]]


def judge(result: Result, sample: Sample, n_runs: int, has_sizes: bool) -> str:
    """The verdict on a number, by the first two of `RULES`."""
    if not n_runs:
        return NO_DATA
    if result.value is None:
        return NO_NUMBER
    ours = quartiles(sample.values)
    value = _central(result, sample)
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


def has_sizes(some: list[Run], needs: tuple[str, ...]) -> bool:
    """Whether all runs (at least one, of one task) are at least as large as the paper's in all that is named."""
    needed = sizes.of_paper(some[0].settings.task)
    return all(sizes.of_run(run)[name] >= needed[name] for run in some for name in needs)


def _row(result: Result, some: list[Run]) -> Row:
    measure = MEASURES[result.measure]
    gathered = gather(some, measure.read)
    found, missing = list(gathered.found.values()), list(gathered.missing.values())
    if not found:
        nothing = Quartiles(np.nan, np.nan, np.nan)
        return Row(result, measure.unit, 0, np.nan, nothing, (np.nan, np.nan), None, NO_DATA, missing)
    sample = Sample.join(found)
    return Row(
        result=result,
        unit=measure.unit,
        n_runs=len(found),
        value=_central(result, sample),
        quartiles=Quartiles(*map(float, quartiles(sample.values))),
        interval=median_interval(sample.values),
        not_reached=int(np.isinf(sample.values).sum()) if np.isfinite(sample.given) else None,
        verdict=judge(result, sample, len(found), has_sizes(some, measure.needs)),
        missing=missing,
    )


def _finding(conclusion: Conclusion, some: list[Run]) -> Finding:
    greater, smaller = (gather(some, MEASURES[name].read).found for name in (conclusion.greater, conclusion.smaller))
    both = [run for run in greater if run in smaller]
    if not both:
        return Finding(conclusion, 0, (np.nan, np.nan), Comparison(np.nan, np.nan), NO_DATA)
    first, second = (np.concatenate([of[run].values for run in both]) for of in (greater, smaller))
    comparison = mann_whitney(first, second)
    top = float(max(first.max(), second.max()))
    verdict = judge_order(comparison, top, len(both), has_sizes(some, _NEEDED_FOR_ORDER))
    return Finding(conclusion, len(both), (float(np.median(first)), float(np.median(second))), comparison, verdict)


def _central(result: Result, sample: Sample) -> float:
    return float({"median": np.median, "mean": np.mean}[result.statistic](sample.values))
