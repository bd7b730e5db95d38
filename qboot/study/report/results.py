"""The results of a study as a page of Markdown with its figures: `docs/results.md` is made by `write`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from qboot.study.analysis import appendix, verdicts
from qboot.study.analysis.claims import claims, counted
from qboot.study.analysis.rules import RULES
from qboot.study.controls.cells import find, folder_of
from qboot.study.controls.conditions import WHATS
from qboot.study.figures import catalogue
from qboot.study.figures.drawing import Drawn
from qboot.study.report import tables
from qboot.study.report.page import origins
from qboot.study.report.templating import as_title
from qboot.study.store import files, runs
from qboot.study.store.artifacts import task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings
from qboot.study.store.timing import seconds_by_step

START, END = "<!-- made from the results of a study -->", "<!-- end of what is made -->"
# Figures of scores: what is published of a study is enough for them.
PLOTS = ("learning_on_source", "generalisation", "learning_on_target")

Runs = list[Run[RunSettings]]


def write(study: Path, docs: Path) -> Path:
    """Write DOCS/results.md and DOCS/figures/figNN_TASK.png from a study, or from what was published of one.

    In a page that is there already, only what lies between the two marks is replaced.

    Raises:
        RunError: if there are no runs below `study`, or none can be read.
    """
    some, _ = runs.runs_below(study)
    by_task: dict[str, Runs] = {}
    for run in some:
        by_task.setdefault(run.task_name, []).append(run)
    sections = [_section(study, of_task, docs / "figures") for of_task in by_task.values()]
    path = docs / "results.md"
    files.write_text(path, _inserted(path, "\n".join([_made_with(study, some), *sections])))
    return path


def _inserted(path: Path, made: str) -> str:
    """The page with what is made in its place."""
    before, after = "# Results\n\n", "\n"
    if path.exists():
        text = path.read_text()
        if START not in text or END not in text:
            raise RunError(f"{path} lacks the marks {START} and {END}: put them around what is to be replaced")
        before, _, rest = text.partition(START)
        _, _, after = rest.partition(END)
    return f"{before}{START}\n{made}\n{END}{after}"


def _made_with(study: Path, some: Runs) -> str:
    hours = sum(sum(seconds_by_step(folder).values()) for folder in _folders(study, some)) / 3_600
    seeds = sorted({run.settings.seed for run in some})
    lines = [
        f"{len(some)} evolved runs, seeds {', '.join(map(str, seeds))}"
        + (f"; {hours:.1f} core-hours of one thread each, where a runner recorded them" if hours else "")
        + ". Made by:",
        "",
        "    python experiments/results.py STUDY --docs docs",
        "",
        *(f"* {name}: {', '.join(values)}" for name, values in origins(some).items()),
        "",
        "How a verdict is reached:",
        "",
        *(f"* {rule}" for rule in RULES),
        "",
    ]
    return "\n".join(lines)


def _section(study: Path, some: Runs, figures: Path) -> str:
    task_name = some[0].settings.task
    cells = {what: find(study, task_name, what) for what in WHATS}
    answered = claims(verdicts.rows(some), [*verdicts.findings(some), *appendix.findings(cells, some)])
    lines = [f"## {as_title(some[0].task_name)}", "", counted(answered), ""]
    for title, table in tables.of_task(some, cells, answered).items():
        lines += [f"### {title}", "", table, ""]
    for name in PLOTS:
        lines += _figure(name, some, partial(catalogue.draw, name, some), figures)
    for what in WHATS:
        if cells[what]:
            lines += _figure(what, some, partial(catalogue.draw_control, what, study, task_name), figures)
    return "\n".join(lines)


def _figure(name: str, some: Runs, draw: Callable[[], Drawn], figures: Path) -> list[str]:
    """The lines of a figure, which is drawn into its file; none where there is nothing to draw."""
    task = task_of(some[0])
    try:
        drawn = draw()
    except RunError:
        return []
    printed = catalogue.printed_as(task, name)
    number = f"fig{printed.number:02}" if printed else name
    file = figures / f"{number}_{task.name}.png"
    files.write(file, catalogue.as_png(drawn.figure))
    title = (catalogue.RUN_PLOTS | catalogue.CONTROL_PLOTS)[name].title
    words = [f"Ours: {drawn.shows}"]
    if printed:
        title, words = f"Figure {printed.number}. {title}", [f"The paper: {printed.shows}", *words]
    return [f"### {title}", "", f"![{title}](figures/{file.name})", "", *(f"* {word}" for word in words), ""]


def _folders(study: Path, some: Runs) -> list[Path]:
    """All folders that a runner notes times in."""
    names = dict.fromkeys(run.task_name for run in some)
    return [run.folder for run in some] + [folder_of(study, name, what) for name in names for what in WHATS]
