"""Which figures there are, by name, and what each needs; a paper's number and words come from the task's `paper`."""

import argparse
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib
from matplotlib.figure import Figure

from qboot.envs import get_task, names
from qboot.envs.task import Task
from qboot.study.analysis.control_measures import CellsByCondition
from qboot.study.analysis.printed import PrintedFigure
from qboot.study.controls import cells
from qboot.study.figures import behaviour, controls, environment, scores, segmentation
from qboot.study.figures.drawing import STYLE, Drawn
from qboot.study.store import files, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

DOTS_PER_INCH = 110


class RunPlot(NamedTuple):
    """A figure on runs."""

    title: str
    needs: Callable[[Task], object]  # what a task must have; the figure is left out where there is nothing
    draw: Callable[[list[Run[RunSettings]]], Drawn]  # from runs of one task, at least one


class ControlPlot(NamedTuple):
    """A figure on a control experiment, whose name is that of the experiment (`qboot.study.controls.conditions`)."""

    title: str
    draw: Callable[[CellsByCondition], Drawn]  # from the cells of one task by condition


def nothing(task: Task) -> bool:
    """For figures that need nothing of a task."""
    return True


RUN_PLOTS = {
    "segmentation": RunPlot("How commands are cut into actions", nothing, segmentation.segmentation),
    "environment": RunPlot("The environment", lambda task: task.view and task.view.picture, environment.environment),
    "domains": RunPlot("The domains", lambda task: task.view, environment.domains),
    "evolved_behaviour": RunPlot("A best network's behaviour", lambda task: task.view, behaviour.evolved_behaviour),
    "learning_on_source": RunPlot("Learning on the source set", nothing, scores.learning_on_source),
    "learned_behaviour": RunPlot("A Q-policy's behaviour", lambda task: task.view, behaviour.learned_behaviour),
    "generalisation": RunPlot("Generalisation to new domains", nothing, scores.generalising),
    "learning_on_target": RunPlot("Learning on the target set", nothing, scores.learning_on_target),
}

CONTROL_PLOTS = {
    "actions": ControlPlot("Where the actions come from", controls.learning_by_actions),
    "sensors": ControlPlot("Sensors for the state", controls.performance_by_sensors),
    "n_actions": ControlPlot("The number of actions", controls.performance_by_n_actions),
}


def names_of(task: Task) -> list[str]:
    """Names of the figures on runs of a task, those with a number in its paper first, in the paper's order."""
    some = [name for name, plot in RUN_PLOTS.items() if plot.needs(task)]
    numbers = {name: printed.number for name, printed in _printed(task).items()}
    return sorted(some, key=lambda name: numbers.get(name, float("inf")))


def printed_as(task: Task, name: str) -> PrintedFigure | None:
    """The figure of a name in the task's paper; None where there is no paper, or no such figure in it."""
    return _printed(task).get(name)


def draw(name: str, some: list[Run[RunSettings]]) -> Drawn:
    """Draw one of RUN_PLOTS from runs of one task, at least one.

    Raises:
        RunError: if none has the files that the figure needs.
    """
    with matplotlib.rc_context(STYLE):
        return RUN_PLOTS[name].draw(some)


def draw_so_far(run: Run[RunSettings]) -> Drawn:
    """Draw the curves of one run, which may still be going on.

    Raises:
        RunError: if it has none yet, or a file that cannot be used.
    """
    with matplotlib.rc_context(STYLE):
        return scores.so_far(run)


def draw_control(name: str, study: Path, task_name: str) -> Drawn:
    """Draw one of CONTROL_PLOTS from a task's cells in the folder of a study.

    Raises:
        RunError: if there are none.
    """
    found = cells.find(study, task_name, name)
    if not found:
        raise RunError(
            f"no finished cells below {study}: make them with `qboot ablate --task {task_name} --what {name} "
            f"--out {study}`"
        )
    with matplotlib.rc_context(STYLE):
        return CONTROL_PLOTS[name].draw(found)


def as_png(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return stream.getvalue()


def command(number: int, arguments: list[str] | None = None) -> int:
    """Draw the figure that has a number in a task's paper, from the command line.

    Returns:
        The exit code: 0 done, 2 bad input.
    """
    task, name = _numbered(number)
    is_control = name in CONTROL_PLOTS
    parser = argparse.ArgumentParser(description=f"Draw figure {number} of the paper from finished runs.")
    parser.add_argument("results", type=Path, metavar="RESULTS_FOLDER", help="folder of a study, or of one run")
    if is_control:
        parser.add_argument("--task", help="as in `qboot ablate`; default the first that has cells")
    parser.add_argument("--out", type=Path, default=Path(f"fig{number:02}.png"), metavar="FILE.png")
    options = parser.parse_args(arguments)
    try:
        if is_control:
            drawn = draw_control(name, options.results, options.task or _with_cells(options.results, name))
        else:
            drawn = draw(name, _of_task(task, options.results))
        files.write(options.out, as_png(drawn.figure))
    except (RunError, ValueError) as error:
        print(f"figure {number}: {error}", file=sys.stderr)
        return 2
    print(f"{options.out}: {drawn.shows}")
    return 0


def _printed(task: Task) -> dict[str, PrintedFigure]:
    return dict(task.paper().figures) if task.paper else {}


def _numbered(number: int) -> tuple[Task, str]:
    """The first registered task whose paper has a figure of this number, and the figure's name."""
    for task in map(get_task, names()):
        for name, printed in _printed(task).items():
            if printed.number == number:
                return task, name
    raise ValueError(f"no paper of a registered task has a figure {number}")


def _of_task(task: Task, folder: Path) -> list[Run[RunSettings]]:
    found = [run for run in runs.runs_below(folder).runs if run.task_name == task.name]
    if not found:
        raise RunError(f"it needs runs of {task.name}, and there are none: give the folder of such a study")
    return found


def _with_cells(study: Path, what: str) -> str:
    """Name of the first registered task with a folder of cells, or else of the first."""
    return next((name for name in names() if cells.folder_of(study, name, what).is_dir()), names()[0])
