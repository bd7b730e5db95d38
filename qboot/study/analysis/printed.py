"""What a paper printed about a task, as data: the types. Each task that a paper tells of has its own `paper.py`.

A paper may give quartiles of performance: its "upper quartile" reaches a score first. Here the lower quartile is
always the smaller number, so for times it is that of the faster runs.
"""

from collections.abc import Mapping
from typing import NamedTuple

GREATER, SAME = "greater", "same"


class Result(NamedTuple):
    """One number of a paper over its runs."""

    measure: str  # name in `qboot.study.analysis.measures.RUN_MEASURES`
    section: str
    value: float | None  # None where the paper prints none
    lower: float | None = None
    upper: float | None = None
    statistic: str = "median"  # or "mean"


class Conclusion(NamedTuple):
    """A paper's claim on two things: that the first is greater, or that they do not differ."""

    claim: str
    section: str
    first: str  # names in `qboot.study.analysis.measures.RUN_MEASURES`
    second: str
    printed: str  # the paper's own test or numbers
    relation: str = GREATER  # or SAME
    reservation: str = ""  # why our numbers are no evidence on it; empty where they are


class TestTable(NamedTuple):
    """A triangular table of p-values of Mann-Whitney tests between conditions of a control experiment."""

    title: str
    section: str
    what: str  # the control experiment
    measure: str  # name in `qboot.study.analysis.control_measures.CONTROL_MEASURES`
    # Of two conditions: several where it is printed several times, none where there is no number, None without a paper.
    printed: Mapping[tuple[str, str], tuple[float, ...] | None]
    shares: tuple[float, ...] = (1.0,)  # of the episodes, after which ours is tested
    reservations: Mapping[str, str] = {}  # by condition: why our numbers with it are no evidence


class ControlConclusion(NamedTuple):
    """A paper's claim on a measure in two conditions of a control experiment."""

    conclusion: Conclusion  # first and second are names of conditions
    what: str
    measure: str


class PrintedFigure(NamedTuple):
    """A figure of a paper."""

    number: int
    shows: str


class Paper(NamedTuple):
    """All that a paper printed about one task."""

    results: tuple[Result, ...]
    conclusions: tuple[Conclusion, ...]
    test_tables: tuple[TestTable, ...]
    control_conclusions: tuple[ControlConclusion, ...]
    figures: Mapping[str, PrintedFigure]  # by name in `qboot.study.figures.catalogue`
    not_printed: tuple[str, ...] = ()  # sizes of the profile "paper" that the paper does not give
