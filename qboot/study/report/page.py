"""The report on a study: one self-contained HTML page with our numbers and figures beside the paper's."""

import base64
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.study.analysis import appendix, sizes, verdicts
from qboot.study.analysis.curves import gather, runs_below, source_curve
from qboot.study.analysis.sizes import Size
from qboot.study.analysis.verdicts import Finding, Row
from qboot.study.controls import conditions as ablations
from qboot.study.figures.catalogue import catalogue as figures
from qboot.study.figures.catalogue.catalogue import ABLATION_PLOTS, PLOTS, AblationPlot, Plot
from qboot.study.figures.catalogue.drawing import Drawn
from qboot.study.figures.catalogue.extraction import best_run
from qboot.study.pipeline import profiles
from qboot.study.report.page import player as replay
from qboot.study.report.page.player import PAGES, Player
from qboot.study.store import files
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run

# The last file that each stage writes.
STAGE_FILES = {"evolve": "pareto.npz", "extract": "sensors.npz", "learn": "qnets.npz", "transfer": "transfer.csv"}


class Picture(NamedTuple):
    """A figure as the page shows it."""

    number: int
    plot: Plot | AblationPlot
    shows: str  # what ours shows, or why there is none
    runs: list[str]
    png: str  # base64, empty when there is none


class RunLine(NamedTuple):
    """One run in the table of runs."""

    run: Run
    best: float  # best score of ER on the source set, NaN if it has none
    done: dict[str, bool]  # by stage
    seconds: dict[str, float]  # wall time by stage, where it was recorded


class Experiment(NamedTuple):
    """One control experiment as the page shows it."""

    picture: Picture
    meanings: dict[str, str]  # of its conditions
    episodes: tuple[int, ...]  # the different numbers that cells have, smallest first; empty without cells
    paper_episodes: int
    n_cells: tuple[int, ...]  # per condition, likewise
    seconds: float  # wall time, 0 where it was not recorded
    tables: list[appendix.Table]


class Section(NamedTuple):
    """All that the page says on one task."""

    task: str
    sizes: list[Size]
    rows: list[Row]
    findings: list[Finding]
    pictures: list[Picture]
    control_findings: list[Finding]
    experiments: list[Experiment]
    players: list[Player]
    player_run: str  # label of the run that is played, or why none is
    lines: list[RunLine]
    missing: list[str]  # files that lack or cannot be read


def write(out: Path) -> Path:
    """Write OUT/report.html on all runs below `out`; what is missing is named in it.

    Raises:
        RunError: if there are no runs below `out`, or a configuration cannot be read.
    """
    some = runs_below(out)
    tasks = dict.fromkeys(run.settings.task for run in some)
    sections = [_section(out, task, [run for run in some if run.settings.task == task]) for task in tasks]
    page = PAGES.get_template("report.html.jinja").render(
        sections=sections,
        profiles=sorted({run.settings.profile for run in some}),
        origins=_origins(some),
        rules=(*verdicts.RULES, *appendix.RULES),
        stages=tuple(STAGE_FILES),
    )
    path = out / "report.html"
    files.write_text(path, page)
    return path


def as_number(value: float) -> str:
    """A number for people: no more digits than say something."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "never"
    if abs(value) >= 100 or value == int(value):
        return f"{value:,.0f}"
    return f"{value:.3g}"


def as_duration(seconds: float) -> str:
    """A wall time for people."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6_000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3_600:.1f} h"


def _section(study: Path, task: str, some: list[Run]) -> Section:
    players, player_run = _played(some)
    rows = verdicts.rows(some)
    cells = {what: ablations.find(study, task, what) for what in ablations.WHATS}
    tables = appendix.tables(cells, some)
    return Section(
        task=task,
        sizes=sizes.beside_paper(some),
        rows=rows,
        findings=verdicts.findings(some),
        pictures=[
            _picture(number, plot, lambda number=number: figures.draw(number, some))
            for number, plot in PLOTS[task].items()
        ],
        control_findings=appendix.findings(cells, some),
        experiments=[_experiment(study, task, number, cells, tables) for number in ABLATION_PLOTS],
        players=players,
        player_run=player_run,
        lines=[_line(run) for run in some],
        missing=sorted({reason for row in rows for reason in row.missing}),
    )


def _experiment(
    study: Path, task: str, number: int, cells: dict[str, appendix.Cells], tables: list[appendix.Table]
) -> Experiment:
    plot = ABLATION_PLOTS[number]
    of_conditions = cells[plot.what].values()
    return Experiment(
        picture=_picture(number, plot, lambda: figures.draw_ablation(number, study, task)),
        meanings={name: each.meaning for name, each in ablations.conditions(task, plot.what).items()},
        episodes=tuple(sorted({cell.settings.episodes for some in of_conditions for cell in some})),
        paper_episodes=profiles.sweep_of(task, plot.what, "paper").episodes,
        n_cells=tuple(sorted({len(some) for some in of_conditions})),
        seconds=sum(_seconds(ablations.folder_of(study, task, plot.what)).values()),
        tables=[table for table in tables if table.table.what == plot.what],
    )


def _picture(number: int, plot: Plot | AblationPlot, draw: Callable[[], Drawn]) -> Picture:
    try:
        drawn = draw()
    except RunError as error:
        return Picture(number, plot, str(error), [], "")
    png = base64.b64encode(figures.as_png(drawn.figure)).decode()
    return Picture(number, plot, drawn.shows, drawn.runs, png)


def _played(some: list[Run]) -> tuple[list[Player], str]:
    try:
        run = best_run(some, "lineage.npz", "actions.npz", "sensors.npz", "qnets.npz")
        return replay.players(run), run.label
    except RunError as error:
        return [], str(error)


def _line(run: Run) -> RunLine:
    best = gather([run], lambda run: float(source_curve(run, "ER").scores.max())).found.get(run, np.nan)
    done = {stage: run.file(name).exists() for stage, name in STAGE_FILES.items()}
    return RunLine(run, best, done, _seconds(run.folder))


def _seconds(folder: Path) -> dict[str, float]:
    """Wall time by stage of a run or an experiment: sums over starts, from timing.csv (`stage,seconds` a line)."""
    total: dict[str, float] = {}
    path = folder / "timing.csv"
    for line in path.read_text().splitlines() if path.exists() else ():
        stage, _, seconds = line.partition(",")
        total[stage] = total.get(stage, 0.0) + float(seconds)
    return total


def _origins(some: list[Run]) -> dict[str, list[str]]:
    """With what the runs were made: the different values that their configurations hold."""
    configs = [files.read_json(run.file("config.json")) for run in some]

    def different(read: Callable[[dict], str]) -> list[str]:
        return sorted({read(config) or "not known" for config in configs})

    packages = different(lambda config: ", ".join(f"{name} {v}" for name, v in config.get("packages", {}).items()))
    return {
        "qboot": different(lambda config: config.get("qboot", "")),
        "git commit (+: changed since)": different(lambda config: config.get("git_commit", "")),
        "Python": different(lambda config: config.get("python", "")),
        "packages": packages,
        "machine": different(lambda config: config.get("machine", "")),
        "XLA flags": different(lambda config: config.get("xla_flags", "")),
    }


PAGES.filters |= {"number": as_number, "duration": as_duration}
