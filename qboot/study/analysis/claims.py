"""Every claim of a paper in one table: what it says, what we found, and whether that agrees, differs or cannot be told.

The claims are those of the task's `paper.py`: its numbers, its conclusions on runs, and those on control experiments.
"""

from typing import NamedTuple

from qboot.study.analysis import appendix, verdicts
from qboot.study.analysis.appendix import Cells
from qboot.study.analysis.printed import SAME
from qboot.study.analysis.rules import AGREES, CANNOT_TELL, DIFFERS, Verdict
from qboot.study.analysis.verdicts import Finding, Row
from qboot.study.analysis.words import as_number
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class Claim(NamedTuple):
    """A claim and the answer to it."""

    claim: str
    section: str
    printed: str  # the paper's numbers
    ours: str
    n: int  # runs or learners behind ours
    verdict: Verdict


def claims(cells: dict[str, Cells], some: list[Run[RunSettings]]) -> list[Claim]:
    """The claims on one task, in the order of the paper; none without a paper.

    Args:
        cells: finished cells of each control experiment by its name.
        some: all runs of the task in the study, at least one.
    """
    numbers = [_number(row) for row in verdicts.rows(some) if row.printed and row.printed.value is not None]
    return numbers + [_order(each) for each in (*verdicts.findings(some), *appendix.findings(cells, some))]


def counted(some: list[Claim]) -> str:
    """How many claims have which answer, in a sentence."""
    answers = [claim.verdict.answer for claim in some]
    return (
        f"Of the paper's {len(answers)} claims {answers.count(AGREES)} agree, {answers.count(DIFFERS)} differ and of "
        f"{answers.count(CANNOT_TELL)} it cannot be told."
    )


def _number(row: Row) -> Claim:
    printed = row.printed
    assert printed is not None and printed.value is not None
    theirs = _with_quartiles(printed.value, printed.lower, printed.upper)
    ours = _with_quartiles(row.value, row.quartiles.lower, row.quartiles.upper) if row.n_runs else "–"
    claim = f"{row.measure[:1].upper()}{row.measure[1:]}, {row.statistic} (quartiles)"
    return Claim(claim, printed.section, theirs, ours, row.n_runs, row.verdict)


def _order(finding: Finding) -> Claim:
    conclusion = finding.conclusion
    ours = "–"
    if finding.n_runs:
        ours = f"medians {as_number(finding.medians[0])} and {as_number(finding.medians[1])}; "
        low, high = map(as_number, finding.interval)
        p, a12 = map(as_number, finding.comparison)
        ours += f"difference [{low}, {high}] (90 %)" if conclusion.relation == SAME else f"p = {p}, A12 = {a12}"
    return Claim(conclusion.claim, conclusion.section, conclusion.printed, ours, finding.n_runs, finding.verdict)


def _with_quartiles(value: float, lower: float | None, upper: float | None) -> str:
    if lower is None and upper is None:
        return as_number(value)
    ends = ("–" if end is None else as_number(end) for end in (lower, upper))
    return f"{as_number(value)} ({' to '.join(ends)})"
