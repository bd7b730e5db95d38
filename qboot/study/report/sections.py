"""What the report says on one task: parts with a heading each; what there is nothing for has none."""

import base64
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from qboot.envs.task import Task
from qboot.study.analysis import appendix, sizes, verdicts
from qboot.study.analysis.claims import claims
from qboot.study.analysis.control_measures import CellsByCondition
from qboot.study.analysis.gathering import best_run, best_score, gather
from qboot.study.analysis.printed import PrintedFigure
from qboot.study.analysis.summary import Summary, has_numbers, summary
from qboot.study.analysis.verdicts import Finding, Row
from qboot.study.controls.cells import faults, find, folder_of
from qboot.study.controls.conditions import WHATS, conditions
from qboot.study.figures import catalogue
from qboot.study.figures.catalogue import CONTROL_PLOTS, RUN_PLOTS
from qboot.study.figures.drawing import Drawn
from qboot.study.pipeline import profiles
from qboot.study.pipeline.profiles import ControlSize
from qboot.study.pipeline.table import STAGES
from qboot.study.report import player
from qboot.study.report.player import Player
from qboot.study.store.artifacts import task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings
from qboot.study.store.timing import seconds_by_step

Runs = list[Run[RunSettings]]  # of one task, at least one


class Part(NamedTuple):
    """A part of a section, drawn by `templates/parts/KIND.html.jinja`."""

    kind: str
    anchor: str  # of links to it, unique within its section
    link: str  # its entry in the contents
    heading: str
    content: Any


class Section(NamedTuple):
    """All that the page says on one task."""

    task: str
    has_paper: bool
    summary: Summary
    parts: list[Part]  # what answers comes first, what it rests on after it


class Picture(NamedTuple):
    """A figure as the page shows it."""

    title: str
    printed: PrintedFigure | None  # the paper's
    shows: str  # what ours shows, or why there is none
    runs: list[str]
    n_runs: int  # of how many; 0 where it is not said
    png: str  # base64, empty when there is none

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"Figure {self.printed.number}. {self.title}" if self.printed else self.title


class Experiment(NamedTuple):
    """One control experiment."""

    picture: Picture
    meanings: dict[str, str]  # of its conditions
    episodes: tuple[int, ...]  # the different numbers that cells have, smallest first
    n_cells: tuple[int, ...]  # per condition, likewise
    paper: ControlSize | None
    seconds: float  # wall time, 0 where it was not recorded
    tables: list[appendix.Table]


class Watched(NamedTuple):
    """The rollouts that the page plays."""

    player: Player | None
    run: str  # label of their run, or why there is none


class RunLine(NamedTuple):
    """One run in the table of runs."""

    run: Run[RunSettings]
    best: float  # best score of ER on the source set, NaN if it has none
    done: dict[str, bool]  # by stage, as far as numbers go
    seconds: dict[str, float]  # wall time by stage, where it was recorded


class RunTable(NamedTuple):
    """The runs, and what could not be said because something is missing."""

    lines: list[RunLine]
    missing: list[str]


def section(study: Path, some: Runs) -> Section:
    """All that the page says on the task of `some` runs of a study."""
    task = task_of(some[0])
    cells, missing = _cells(study, some)
    rows, on_runs, on_cells = verdicts.rows(some), verdicts.findings(some), appendix.findings(cells, some)
    answered = claims(rows, [*on_runs, *on_cells])
    missing += sorted({reason for row in rows for reason in row.missing})
    parts = [
        *_conclusions(on_runs),
        *_figures(task, some),
        *_watched(task, some),
        *_controls(study, task, some, cells, on_cells),
        *_numbers(task, rows),
        Part("sizes", "sizes", "Sizes", "Sizes", sizes.rows(some)),
        Part("runs", "runs", "Runs", "Runs", RunTable([_line(run) for run in some], missing)),
    ]
    return Section(task.name, task.paper is not None, summary(cells, some, answered), parts)


def _conclusions(found: list[Finding]) -> list[Part]:
    return [Part("conclusions", "conclusions", "Conclusions", "The paper's conclusions", found)] if found else []


def _numbers(task: Task, rows: list[Row]) -> list[Part]:
    # A paper's number that we have not measured is said; without a paper there is nothing to say.
    shown = [row for row in rows if row.printed or row.n_runs]
    heading = "The paper's numbers" if task.paper else "Numbers"
    return [Part("numbers", "numbers", "Numbers", heading, shown)] if shown else []


def _figures(task: Task, some: Runs) -> list[Part]:
    found = []
    for name in catalogue.names_of(task):
        printed = catalogue.printed_as(task, name)
        picture = _picture(RUN_PLOTS[name].title, printed, partial(catalogue.draw, name, some), len(some))
        found.append(_figure_part("figure", name, picture, picture))
    return found


def _cells(study: Path, some: Runs) -> tuple[dict[str, CellsByCondition], list[str]]:
    """The finished cells of each experiment, and why others cannot be read."""
    found: dict[str, CellsByCondition] = {}
    missing = []
    for what in WHATS:
        try:
            found[what] = find(study, some[0].settings.task, what)
        except RunError as error:
            found[what] = {}
            missing.append(str(error))
        else:
            missing += faults(study, some[0].settings.task, what)
            if not found[what]:
                missing.append(f"no cells of the control experiment {what}: qboot ablate makes them")
    return found, missing


def _controls(
    study: Path, task: Task, some: Runs, cells: dict[str, CellsByCondition], found: list[Finding]
) -> list[Part]:
    """The control experiments that there are cells of, and what was found on them."""
    if not any(cells.values()):
        return []
    heading = "Control experiments (section VII, appendix A)"
    tables = [table for table in appendix.tables(cells, some) if table.episodes]
    parts = [Part("controls", "controls", "Control experiments", heading, found)]
    for what in (what for what in WHATS if cells[what]):
        of_experiment = [table for table in tables if table.table.what == what]
        experiment = _experiment(study, task, some[0].settings.task, what, cells[what], of_experiment)
        parts.append(_figure_part("experiment", what, experiment.picture, experiment))
    return parts


def _experiment(
    study: Path, task: Task, task_name: str, what: str, cells: CellsByCondition, tables: list[appendix.Table]
) -> Experiment:
    printed = catalogue.printed_as(task, what)
    return Experiment(
        picture=_picture(
            CONTROL_PLOTS[what].title, printed, partial(catalogue.draw_control, what, study, task_name), n_runs=0
        ),
        meanings={name: each.meaning for name, each in conditions(task, what).items()},
        episodes=tuple(sorted({cell.settings.episodes for some in cells.values() for cell in some})),
        n_cells=tuple(sorted({len(some) for some in cells.values()})),
        paper=profiles.control_size_of(task, what, "paper") if task.paper else None,
        seconds=sum(seconds_by_step(folder_of(study, task.name, what)).values()),
        tables=tables,
    )


def _watched(task: Task, some: Runs) -> list[Part]:
    if task.view is None:
        return []
    try:
        run = best_run(some, "lineage.npz", "actions.npz", "sensors.npz", "qnets.npz")
        watched = Watched(player.player(run), run.label)
    except RunError as error:
        watched = Watched(None, str(error))
    return [Part("players", "players", "Players", "Rollouts to watch", watched)]


def _figure_part(kind: str, name: str, picture: Picture, content: Any) -> Part:
    link = f"Figure {picture.printed.number}" if picture.printed else picture.title
    return Part(kind, f"figure-{name}", link, picture.heading, content)


def _picture(title: str, printed: PrintedFigure | None, draw: Callable[[], Drawn], n_runs: int) -> Picture:
    try:
        drawn = draw()
    except RunError as error:
        return Picture(title, printed, str(error), [], n_runs, "")
    png = base64.b64encode(catalogue.as_png(drawn.figure)).decode()
    return Picture(title, printed, drawn.shows, drawn.runs, n_runs, png)


def _line(run: Run[RunSettings]) -> RunLine:
    best = gather([run], best_score).found.get(run, np.nan)
    return RunLine(run, best, {stage.name: has_numbers(run, stage) for stage in STAGES}, seconds_by_step(run.folder))
