"""Appendix A on our cells: Mann-Whitney tests between the conditions of the control experiments, beside the paper's.

Where no paper tells of a task, its conditions are compared all the same, without verdicts.
"""

import itertools
from typing import NamedTuple

import numpy as np

from qboot.study.analysis import verdicts
from qboot.study.analysis.control_measures import CONTROL_MEASURES
from qboot.study.analysis.printed import ControlConclusion, TestTable
from qboot.study.analysis.statistics import Comparison, a12_interval, mann_whitney
from qboot.study.analysis.verdicts import (
    AGREES,
    DIFFERS,
    MIN_RUNS,
    NO_DATA,
    NO_NUMBER,
    NO_PAPER,
    NOT_COMPARABLE,
    SIGNIFICANCE,
    Finding,
)
from qboot.study.pipeline import profiles
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings, RunSettings

# The paper's number of learners per condition: fewer can show a difference, but not that there is none.
PAPER_RUNS = 30

RULES = (
    f"A test between two conditions (appendix A) is compared when each has at least {MIN_RUNS} learners, which had at "
    "least the paper's episodes and steps, and when the evolved runs behind them have the paper's sizes. It agrees "
    f"when both or neither of the two p-values, the paper's and ours, are below {SIGNIFICANCE}. Where ours is not, and "
    f"a condition has fewer than the paper's {PAPER_RUNS} learners, it is not comparable: fewer learners can show a "
    "difference, but not that there is none.",
    "The paper prints its tests on actions for three numbers of episodes, which ours need not reach; ours are made "
    "after a third, two thirds and all of the episodes, and each is set beside the paper's three values. Where those "
    "do not lie on one side of the threshold, there is no verdict.",
)

Cells = dict[str, list[Run[CellSettings]]]  # finished cells of one experiment by condition


class Pair(NamedTuple):
    """Two conditions compared."""

    n_cells: tuple[int, int]
    medians: tuple[float, float]  # NaN where there are no cells
    comparison: Comparison
    interval: tuple[float, float]  # 95 % bootstrap interval of A12
    printed: tuple[float, ...] | None  # the paper's p-values; None without a paper
    verdict: str


class Table(NamedTuple):
    """One triangular table: each condition against those that follow it."""

    table: TestTable
    episodes: int  # after which it was measured; 0 without cells
    names: list[str]  # conditions in the paper's order
    pairs: dict[tuple[str, str], Pair]


def tables(cells: dict[str, Cells], some: list[Run[RunSettings]]) -> list[Table]:
    """The tables of a task: the paper's, or, where none tells of it, one of each experiment's performance.

    Args:
        cells: finished cells of each experiment by its name.
        some: all runs of the task in the study, at least one.
    """
    paper = task_of(some[0]).paper
    wanted = paper().test_tables if paper else _own_tables(cells)
    found = []
    for table in wanted:
        of_table = cells[table.what]
        comparable = has_sizes(of_table, some)
        found += [_table(table, share, of_table, comparable) for share in table.shares]
    return found


def findings(cells: dict[str, Cells], some: list[Run[RunSettings]]) -> list[Finding]:
    """The paper's conclusions from a task's control experiments, tested on our cells; arguments as for `tables`."""
    paper = task_of(some[0]).paper
    conclusions = paper().control_conclusions if paper else ()
    return [_finding(each, cells[each.what], has_sizes(cells[each.what], some)) for each in conclusions]


def judge(p_value: float, printed: tuple[float, ...] | None, n_cells: int, comparable: bool) -> str:
    """The verdict on a pair by `RULES`; `n_cells` of the smaller sample."""
    if not n_cells:
        return NO_DATA
    if printed is None:
        return NO_PAPER
    classes = {value < SIGNIFICANCE for value in printed}
    if len(classes) != 1:
        return NO_NUMBER if not classes else "the paper's own differ"
    is_different = p_value < SIGNIFICANCE
    if not comparable or n_cells < (MIN_RUNS if is_different else PAPER_RUNS):
        return NOT_COMPARABLE
    return AGREES if classes == {is_different} else DIFFERS


def has_sizes(cells: Cells, some: list[Run[RunSettings]]) -> bool:
    """Whether cells, and the evolved runs behind them, are at least as large as the paper's."""
    if not verdicts.has_sizes(some, ("population", "generations", "n_steps", "horizon")):
        return False
    task = task_of(some[0])
    settings = [cell.settings for of_condition in cells.values() for cell in of_condition]
    return all(
        each.episodes >= profiles.control_size_of(task, each.what, "paper").episodes
        and each.n_steps >= profiles.size_of(task, "paper").n_steps
        for each in settings
    )


def _own_tables(cells: dict[str, Cells]) -> list[TestTable]:
    return [
        TestTable(
            f"{what.replace('n_', 'number of ').capitalize()}: performance",
            "",
            what,
            "performance",
            {pair: None for pair in itertools.combinations(of_experiment, 2)},
        )
        for what, of_experiment in cells.items()
        if len(of_experiment) > 1
    ]


def _table(table: TestTable, share: float, cells: Cells, comparable: bool) -> Table:
    names = list(dict.fromkeys(name for pair in table.printed for name in pair))
    values = {name: _values(cells, name, table.measure, share) for name in names}
    pairs = {
        (first, second): _pair(values[first], values[second], printed, comparable)
        for (first, second), printed in table.printed.items()
    }
    episodes = [int(share * cell.settings.episodes) for some in cells.values() for cell in some]
    return Table(table, min(episodes, default=0), names, pairs)


def _pair(first: np.ndarray, second: np.ndarray, printed: tuple[float, ...] | None, comparable: bool) -> Pair:
    n_cells = len(first), len(second)
    if not min(n_cells):
        return Pair(n_cells, (np.nan, np.nan), Comparison(np.nan, np.nan), (np.nan, np.nan), printed, NO_DATA)
    comparison = mann_whitney(first, second)
    medians = float(np.median(first)), float(np.median(second))
    verdict = judge(comparison.p_value, printed, min(n_cells), comparable)
    return Pair(n_cells, medians, comparison, a12_interval(first, second), printed, verdict)


def _finding(claim: ControlConclusion, cells: Cells, comparable: bool) -> Finding:
    conclusion = claim.conclusion
    greater, smaller = (_values(cells, name, claim.measure) for name in (conclusion.greater, conclusion.smaller))
    n_cells = min(len(greater), len(smaller))
    if not n_cells:
        return Finding(conclusion, 0, (np.nan, np.nan), Comparison(np.nan, np.nan), NO_DATA)
    comparison = mann_whitney(greater, smaller)
    scored = max(_values(cells, name, "performance").max() for name in (conclusion.greater, conclusion.smaller))
    verdict = verdicts.judge_order(comparison, scored, n_cells, comparable)
    return Finding(conclusion, n_cells, (float(np.median(greater)), float(np.median(smaller))), comparison, verdict)


def _values(cells: Cells, condition: str, measure: str, share: float = 1.0) -> np.ndarray:
    return np.array([CONTROL_MEASURES[measure](cell, share) for cell in cells.get(condition, [])])
