"""Our numbers beside the paper's, and what follows, by `qboot.study.analysis.rules`.

Where no paper tells of a task there are our numbers alone, and no verdicts.
"""

from typing import NamedTuple

import numpy as np

from qboot.study.analysis import rules, sizes
from qboot.study.analysis.curves import top_score
from qboot.study.analysis.gathering import gather
from qboot.study.analysis.measures import EVOLVED, RUN_MEASURES, Summary, is_evolved
from qboot.study.analysis.printed import SAME, Conclusion, Result
from qboot.study.analysis.rules import CANNOT_TELL, NO_DATA, SAME_WITHIN, Verdict
from qboot.study.analysis.statistics import Comparison, Quartiles, difference_interval, mann_whitney
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# An order of two methods can show in shorter runs too, but not with other populations or rollouts.
NEEDED_FOR_ORDER = ("population", "n_steps")


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
    verdict: Verdict
    missing: list[str]  # why runs have no such number

    @property
    def statistic(self) -> str:
        """What `value` is, "median" or "mean"."""
        return self.printed.statistic if self.printed else "median"


class Finding(NamedTuple):
    """A conclusion of the paper tested on our runs."""

    conclusion: Conclusion
    n_runs: int
    medians: tuple[float, float]  # of the first and of the second; NaN when nothing was measured
    comparison: Comparison
    interval: tuple[float, float]  # 90 % bootstrap interval of the difference of the medians
    verdict: Verdict


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


def found_on(
    conclusion: Conclusion, first: np.ndarray, second: np.ndarray, top: float, best: float, shortfall: str
) -> Finding:
    """A conclusion tested on two samples.

    Args:
        conclusion: the paper's.
        first: (n,) values of what the paper says is the greater, or the same.
        second: (m,) values of the other.
        top: the top score.
        best: the greatest score of any run.
        shortfall: as for `rules.judge_number`.
    """
    n = min(len(first), len(second))
    if not n:
        return Finding(conclusion, 0, (np.nan, np.nan), Comparison(np.nan, np.nan), (np.nan, np.nan), NO_DATA)
    comparison, interval = mann_whitney(first, second), difference_interval(first, second)
    if conclusion.reservation:
        verdict = Verdict(CANNOT_TELL, conclusion.reservation)
    elif conclusion.relation == SAME:
        verdict = rules.judge_same(comparison, interval, SAME_WITHIN * top, best, n, shortfall)
    else:
        verdict = rules.judge_order(comparison, best, n, shortfall)
    medians = float(np.median(first)), float(np.median(second))
    return Finding(conclusion, n, medians, comparison, interval, verdict)


def shortfall(some: list[Run[RunSettings]], needs: tuple[str, ...]) -> str:
    """In which of the sizes named some runs of one task are smaller than the paper's, in words."""
    if not some:
        return ""
    needed = sizes.of_paper(task_of(some[0]))
    if not needed:
        return "no paper tells of it"
    smallest = {name: min(sizes.of_run(run)[name] for run in some) for name in needs if name != EVOLVED}
    short = [f"{sizes.LABELS[name]}: {n:,} of {needed[name]:,}" for name, n in smallest.items() if n < needed[name]]
    if EVOLVED in needs and (n_short := sum(not is_evolved(run, needed["generations"]) for run in some)):
        short.append(f"{n_short} of {len(some)} runs have neither the paper's generations nor the top score")
    return "; ".join(short)


def _row(name: str, printed: Result | None, some: list[Run[RunSettings]]) -> Row:
    measure = RUN_MEASURES[name]
    gathered = gather(some, measure.read)
    found, missing = list(gathered.found.values()), list(gathered.missing.values())
    if not found:
        nothing = Quartiles(np.nan, np.nan, np.nan)
        return Row(name, printed, measure.unit, 0, np.nan, nothing, (np.nan, np.nan), None, NO_DATA, missing)
    summary: Summary = measure.over(found)
    value = summary.mean if printed and printed.statistic == "mean" else summary.quartiles.median
    return Row(
        measure=name,
        printed=printed,
        unit=measure.unit,
        n_runs=len(found),
        value=value,
        quartiles=summary.quartiles,
        interval=summary.interval,
        not_reached=summary.not_reached,
        verdict=rules.judge_number(
            printed, value, summary.quartiles, len(found), summary.given, shortfall(list(gathered.found), measure.needs)
        ),
        missing=missing,
    )


def _finding(conclusion: Conclusion, some: list[Run[RunSettings]]) -> Finding:
    sides = conclusion.first, conclusion.second
    one, other = (gather(some, RUN_MEASURES[name].read).found for name in sides)
    both = [run for run in one if run in other]
    first, second = (np.array([of[run] for run in both], float).reshape(-1) for of in (one, other))
    best = float(max([*first, *second], default=0.0))
    return found_on(conclusion, first, second, top_score(some[0], "target"), best, shortfall(both, NEEDED_FOR_ORDER))
