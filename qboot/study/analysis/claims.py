"""Every claim of a paper in one table: what it says, what we found, and whether that agrees, differs or cannot be told.

The claims are those of the task's `paper.py`: its numbers, its conclusions on runs, and those on control experiments.
"""

from typing import NamedTuple

from qboot.study.analysis.printed import SAME
from qboot.study.analysis.rules import AGREES, CANNOT_TELL, DIFFERS, Verdict
from qboot.study.analysis.verdicts import Finding, Row
from qboot.study.analysis.words import as_number, count


class Claim(NamedTuple):
    """A claim and the answer to it."""

    claim: str
    section: str
    printed: str  # the paper's numbers
    ours: str
    n: int  # runs or learners behind ours
    verdict: Verdict


def claims(rows: list[Row], findings: list[Finding]) -> list[Claim]:
    """The claims on one task, in the order of the paper; none without a paper.

    Args:
        rows: of `verdicts.rows`.
        findings: of `verdicts.findings`, then of `appendix.findings`.
    """
    numbers = [_number(row) for row in rows if row.printed and row.printed.value is not None]
    return numbers + [_order(finding) for finding in findings]


def counted(some: list[Claim]) -> str:
    """How many claims have which answer, in a sentence."""
    answers = [claim.verdict.answer for claim in some]
    agree, differ, untold = map(answers.count, (AGREES, DIFFERS, CANNOT_TELL))
    return (
        f"Of the paper's {count(len(answers), 'claim')} {agree} {AGREES if agree == 1 else 'agree'}, "
        f"{differ} {DIFFERS if differ == 1 else 'differ'} and of {untold} it cannot be told."
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
