"""Appendix A on our cells: Mann-Whitney tests between the conditions of the control experiments, beside the paper's.

Where no paper tells of a task, its conditions are compared all the same, without verdicts.
"""

import itertools
from typing import NamedTuple

import numpy as np

from qboot.study.analysis import rules, verdicts
from qboot.study.analysis.control_measures import CONTROL_MEASURES, CellsByCondition, common_episodes
from qboot.study.analysis.curves import top_score
from qboot.study.analysis.measures import EVOLVED
from qboot.study.analysis.printed import SAME, ControlConclusion, TestTable
from qboot.study.analysis.rules import CANNOT_TELL, NO_DATA, Verdict
from qboot.study.analysis.statistics import Comparison, a12_interval, mann_whitney
from qboot.study.analysis.verdicts import Finding
from qboot.study.pipeline import profiles
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class Pair(NamedTuple):
    """Two conditions compared."""

    n_cells: tuple[int, int]
    medians: tuple[float, float]  # NaN where there are no cells
    comparison: Comparison
    interval: tuple[float, float]  # 95 % bootstrap interval of A12
    printed: tuple[float, ...] | None  # the paper's p-values; None without a paper
    verdict: Verdict


class Table(NamedTuple):
    """One triangular table: each condition against those that follow it."""

    table: TestTable
    episodes: int  # after which it was measured; 0 without cells
    names: list[str]  # conditions in the paper's order
    pairs: dict[tuple[str, str], Pair]


def tables(cells: dict[str, CellsByCondition], some: list[Run[RunSettings]]) -> list[Table]:
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
        short = shortfall(of_table, table.what, some)
        found += [_table(table, share, of_table, short) for share in table.shares]
    return found


def findings(cells: dict[str, CellsByCondition], some: list[Run[RunSettings]]) -> list[Finding]:
    """The paper's conclusions from a task's control experiments, tested on our cells; arguments as for `tables`."""
    paper = task_of(some[0]).paper
    conclusions = paper().control_conclusions if paper else ()
    return [_finding(each, cells[each.what], some) for each in conclusions]


def shortfall(cells: CellsByCondition, what: str, some: list[Run[RunSettings]]) -> str:
    """In what the cells of an experiment, or the evolved runs behind them, are smaller than the paper's, in words."""
    of_runs = _shortfall_of_runs(cells, some, ("population", EVOLVED, "n_steps", "horizon"))
    return of_runs or _shortfall_of_cells(cells, what, some, ("episodes", "n_steps"))


def shortfall_of_order(cells: CellsByCondition, what: str, some: list[Run[RunSettings]]) -> str:
    """The same for a claim that one condition is better than another, which can show after fewer episodes too."""
    of_runs = _shortfall_of_runs(cells, some, verdicts.NEEDED_FOR_ORDER)
    return of_runs or _shortfall_of_cells(cells, what, some, ("n_steps",))


def _shortfall_of_runs(cells: CellsByCondition, some: list[Run[RunSettings]], needs: tuple[str, ...]) -> str:
    """That of the runs that the cells were begun from."""
    behind = {cell.settings.evolved for of_condition in cells.values() for cell in of_condition}
    if gone := behind - {run.folder.name for run in some}:
        return f"evolved runs that are gone: {', '.join(sorted(gone))}"
    return verdicts.shortfall([run for run in some if run.folder.name in behind], needs)


def _shortfall_of_cells(
    cells: CellsByCondition, what: str, some: list[Run[RunSettings]], needs: tuple[str, ...]
) -> str:
    task = task_of(some[0])
    settings = [cell.settings for of_condition in cells.values() for cell in of_condition]
    for name, unit, needed in (
        ("episodes", "episodes of a learner", profiles.control_size_of(task, what, "paper").episodes),
        ("n_steps", "timesteps of a rollout", profiles.size_of(task, "paper").n_steps),
    ):
        least = min((getattr(each, name) for each in settings), default=needed)
        if name in needs and least < needed:
            return f"{unit}: {least:,} of {needed:,}"
    return ""


def _own_tables(cells: dict[str, CellsByCondition]) -> list[TestTable]:
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


def _table(table: TestTable, share: float, cells: CellsByCondition, short: str) -> Table:
    names = list(dict.fromkeys(name for pair in table.printed for name in pair))
    episodes = int(share * common_episodes(cells)) if cells else 0
    values = {name: _values(cells, name, table.measure, episodes) for name in names}
    pairs = {}
    for pair, printed in table.printed.items():
        made = _pair(values[pair[0]], values[pair[1]], printed, short)
        reservation = next((table.reservations[name] for name in pair if name in table.reservations), "")
        if reservation and min(made.n_cells):
            made = made._replace(verdict=Verdict(CANNOT_TELL, reservation))
        pairs[pair] = made
    return Table(table, episodes, names, pairs)


def _pair(first: np.ndarray, second: np.ndarray, printed: tuple[float, ...] | None, short: str) -> Pair:
    n_cells = len(first), len(second)
    if not min(n_cells):
        return Pair(n_cells, (np.nan, np.nan), Comparison(np.nan, np.nan), (np.nan, np.nan), printed, NO_DATA)
    comparison = mann_whitney(first, second)
    medians = float(np.median(first)), float(np.median(second))
    verdict = rules.judge_pair(comparison.p_value, printed, min(n_cells), short)
    return Pair(n_cells, medians, comparison, a12_interval(first, second), printed, verdict)


def _finding(claim: ControlConclusion, cells: CellsByCondition, some: list[Run[RunSettings]]) -> Finding:
    conclusion = claim.conclusion
    names = conclusion.first, conclusion.second
    episodes = common_episodes(cells) if cells else 0
    first, second = (_values(cells, name, claim.measure, episodes) for name in names)
    scores = np.concatenate([_values(cells, name, "performance", episodes) for name in names])
    top = top_score(next(iter(cells.values()))[0], "source") if cells else 0.0
    fall_short = shortfall if conclusion.relation == SAME else shortfall_of_order
    short = fall_short(cells, claim.what, some)
    return verdicts.found_on(conclusion, first, second, top, float(scores.max(initial=0.0)), short)


def _values(cells: CellsByCondition, condition: str, measure: str, episodes: int) -> np.ndarray:
    return np.array([CONTROL_MEASURES[measure](cell, episodes) for cell in cells.get(condition, [])])
