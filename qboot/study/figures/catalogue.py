"""The paper's figures on our runs: which there are, what they show, and how each is drawn (`experiments/fig*.py`)."""

import argparse
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib
from matplotlib.figure import Figure

from qboot.envs import TASKS
from qboot.study.analysis.curves import runs_below
from qboot.study.controls import conditions as ablations
from qboot.study.figures.catalogue import arm as figures_arm
from qboot.study.figures.catalogue import behaviour as figures_behaviour
from qboot.study.figures.catalogue import controls as figures_ablations
from qboot.study.figures.catalogue import extraction as figures_extraction
from qboot.study.figures.catalogue import scores as figures_scores
from qboot.study.figures.catalogue.drawing import STYLE, Drawn
from qboot.study.store import files
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run

DOTS_PER_INCH = 110


class Plot(NamedTuple):
    """A figure of the paper."""

    title: str
    paper: str  # what the paper's figure shows
    draw: Callable[[list[Run]], Drawn]  # from runs of one task, at least one


# Number in the paper to figure, per task: a task's further figures are further rows.
PLOTS = {
    "ball_collecting": {
        3: Plot(
            "How commands are cut into actions",
            "200 steps of two motors, the mean of their second derivatives, the split points in green and the linear "
            "models in red.",
            figures_extraction.segmentation,
        ),
        4: Plot(
            "The domains",
            "Three arenas with three placements of robot, balls, switch and basket each.",
            figures_behaviour.domains,
        ),
        5: Plot(
            "A best network's behaviour",
            "The path of a best individual, red while it carries a ball.",
            figures_behaviour.evolved_behaviour,
        ),
        6: Plot(
            "Learning on the source set",
            "Median and quartiles over 30 runs. ER's median reaches the top score of 8 after 287 generations of 128 "
            "episodes, Q-learning's its best after 481 episodes.",
            figures_scores.learning_on_source,
        ),
        7: Plot(
            "A Q-policy's behaviour",
            "The path of a Q-policy and, in a panel each, where its four actions are in force: turning slightly right "
            "or left, sharply left, and dropping the ball.",
            figures_behaviour.learned_behaviour,
        ),
        8: Plot(
            "Generalisation to new domains",
            "Without further training, medians of 10 (Q-learning) and 2 (ER) of 24 over 30 runs, p = 1.084e-11.",
            figures_scores.generalising,
        ),
        9: Plot(
            "Learning on the target set",
            "Median and quartiles over 30 runs. The medians reach the top score of 24 after 8,616 episodes "
            "(Q-learning), 268,160 (ER) and 305,152 (ER + transfer).",
            figures_scores.learning_on_target,
        ),
    },
    "box_pushing": {
        10: Plot(
            "The environment",
            "A picture of the simulated arm above a table with a box, which it must push by hitting it from the side.",
            figures_arm.environment,
        ),
        11: Plot(
            "The domains",
            "Three source blocks in the top row, three target blocks of other sizes below.",
            figures_behaviour.domains,
        ),
        12: Plot(
            "A best network's behaviour",
            "The path of the end effector from its start to the block.",
            figures_behaviour.evolved_behaviour,
        ),
        13: Plot(
            "A Q-policy's behaviour",
            "The path of the end effector with three actions: one puts the arm high and into a corner, one turns and "
            "descends, one goes straight to the block.",
            figures_behaviour.learned_behaviour,
        ),
        14: Plot(
            "Learning on the source set",
            "Median and quartiles over 30 runs. ER's median reaches the top score of 15 after 390 generations of 128 "
            "episodes.",
            figures_scores.learning_on_source,
        ),
        15: Plot(
            "Generalisation to new domains",
            "Q-learning scores higher than ER without further training, p = 0.04804 (t-test).",
            figures_scores.generalising,
        ),
        16: Plot(
            "Learning on the target set",
            "Median and quartiles over 30 runs. The medians reach the top score of 15 after 2,119 episodes "
            "(Q-learning), 243,328 (ER) and 10,752 (ER + transfer).",
            figures_scores.learning_on_target,
        ),
    },
}


class AblationPlot(NamedTuple):
    """A figure of the paper on a control experiment; both tasks have it."""

    what: str  # name of the experiment (`qboot.study.controls.conditions`)
    title: str
    paper: str  # what the paper's figure shows
    draw: Callable[[dict[str, list[Run]]], Drawn]  # from the cells of one task by condition


ABLATION_PLOTS = {
    17: AblationPlot(
        "actions",
        "Extracted, human-designed and random actions",
        "Median and quartiles over 30 runs. Ball collecting: extracted and human-designed actions perform alike, "
        "random ones seldom learn. Box pushing: all learn soon; extracted actions need fewer steps than "
        "human-designed ones, those fewer than random ones.",
        figures_ablations.learning_by_actions,
    ),
    18: AblationPlot(
        "sensors",
        "Sensors for the state",
        "Without the past (instant) ball collecting is learned worst and box pushing is not harmed; the automatic "
        "selection and as many random inputs (random+) do not differ; box pushing gets half as many inputs as ball "
        "collecting.",
        figures_ablations.performance_by_sensors,
    ),
    19: AblationPlot(
        "n_actions",
        "The number of actions",
        "The final performance does not depend on the number of actions; with more of them, box pushing is learned "
        "slightly more slowly.",
        figures_ablations.performance_by_n_actions,
    ),
}


def draw_ablation(number: int, study: Path, task: str) -> Drawn:
    """Draw one of ABLATION_PLOTS from a task's cells in the folder of a study.

    Raises:
        RunError: if there are none.
    """
    plot = ABLATION_PLOTS[number]
    cells = ablations.find(study, task, plot.what)
    if not cells:
        raise RunError(
            f"no finished cells below {study}: make them with `qboot ablate --task {task} --what {plot.what} "
            f"--out {study}`"
        )
    with matplotlib.rc_context(STYLE):
        return plot.draw(cells)


def draw(number: int, some: list[Run]) -> Drawn:
    """Draw the paper's figure `number` from those of the runs that are of its task.

    Raises:
        RunError: if there is no such run, or none has the files that the figure needs.
    """
    task = next(name for name, plots in PLOTS.items() if number in plots)
    of_task = [run for run in some if run.settings.task == task]
    if not of_task:
        raise RunError(f"figure {number} needs runs of {task}, and there are none: give the folder of such a study")
    with matplotlib.rc_context(STYLE):
        return PLOTS[task][number].draw(of_task)


def as_png(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return stream.getvalue()


def command(number: int, arguments: list[str] | None = None) -> int:
    """Draw one figure from the command line; return the exit code: 0 done, 2 bad input."""
    parser = argparse.ArgumentParser(description=f"Draw figure {number} of the paper from finished runs.")
    parser.add_argument("results", type=Path, metavar="RESULTS_FOLDER", help="folder of a study, or of one run")
    parser.add_argument("--out", type=Path, default=Path(f"fig{number:02}.png"), metavar="FILE.png")
    options = parser.parse_args(arguments)
    try:
        drawn = draw(number, runs_below(options.results))
        files.write(options.out, lambda stream: stream.write(as_png(drawn.figure)))
    except RunError as error:
        print(f"figure {number}: {error}", file=sys.stderr)
        return 2
    print(f"{options.out}: {drawn.shows}")
    return 0


def ablation_command(number: int, arguments: list[str] | None = None) -> int:
    """Draw a figure on a control experiment from the command line; return the exit code: 0 done, 2 bad input."""
    plot = ABLATION_PLOTS[number]
    parser = argparse.ArgumentParser(description=f"Draw figure {number} of the paper from finished cells.")
    parser.add_argument("results", type=Path, metavar="RESULTS_FOLDER", help="folder of a study")
    parser.add_argument("--task", choices=list(TASKS), help="default the first that has cells")
    parser.add_argument("--out", type=Path, default=Path(f"fig{number:02}.png"), metavar="FILE.png")
    options = parser.parse_args(arguments)
    with_cells = [task for task in TASKS if ablations.find(options.results, task, plot.what)]
    try:
        drawn = draw_ablation(number, options.results, options.task or (with_cells or list(TASKS))[0])
        files.write(options.out, lambda stream: stream.write(as_png(drawn.figure)))
    except RunError as error:
        print(f"figure {number}: {error}", file=sys.stderr)
        return 2
    print(f"{options.out}: {drawn.shows}")
    return 0
