"""Other methods beside the paper's in each phase: the same task, budget and seeds, and one figure with a row per phase.

    python experiments/alternatives.py results/alternatives --task box_pushing --physics kinematic --seeds 10

Every seed has a run with the paper's choices. An alternative shares with it all that comes before its phase, copied
from its folder, and differs in one name. Runs are in OUT/PHASE/NAME-SEED; finished ones are not run again, an
interrupted one goes on. Prints a table in Markdown and writes OUT/alternatives.png.
"""

import argparse
import dataclasses
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.extraction.clustering import CLUSTERINGS
from qboot.extraction.segmentation import SEGMENTATIONS
from qboot.extraction.sensors import SELECTIONS
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.qlearning import LEARNERS
from qboot.study.analysis import statistics
from qboot.study.analysis.curves import Curve, common_grid, moving_mean, source_curve, top_score
from qboot.study.figures.drawing import STYLE, new_figure
from qboot.study.pipeline import profiles, table
from qboot.study.store import files, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

EVOLVED = ("history.csv", "lineage.npz", "pareto.npz")
EXTRACTED = ("actions.npz", "sensors.npz")
WINDOW = 20  # episodes of Q-learning that a curve is a mean over
LAST = 1 / 4  # of the episodes, the final score is the mean over


class Phase(NamedTuple):
    """One phase of the method, and who competes in it."""

    title: str
    room: str  # of the settings
    field: str  # whose value is the name
    names: tuple[str, ...]  # the paper's choice first
    shared: tuple[str, ...]  # files of the stages before it
    stages: tuple[str, ...]
    method: str  # whose curve tells


PHASES = {
    "search": Phase("Policy search", "evolution", "algorithm", tuple(ALGORITHMS), (), ("evolve",), "ER"),
    "segmentation": Phase(
        "Cutting commands", "actions", "segmentation", tuple(SEGMENTATIONS), EVOLVED, ("extract", "learn"), "QL"
    ),
    "clustering": Phase(
        "Clustering actions", "actions", "clustering", tuple(CLUSTERINGS), EVOLVED, ("extract", "learn"), "QL"
    ),
    "sensors": Phase(
        "Choosing sensors", "sensors", "selection", tuple(SELECTIONS), EVOLVED, ("extract", "learn"), "QL"
    ),
    "learner": Phase("Learning", "learner", "algorithm", tuple(LEARNERS), (*EVOLVED, *EXTRACTED), ("learn",), "QL"),
}
# What a name needs besides itself, said where the results are: fitted Q learns from kept trajectories alone.
BESIDES = {("learner", "fitted_q"): {"eta": 30}, ("learner", "adam"): {"alpha": 0.001}}


def settings_of(options: argparse.Namespace, seed: int) -> RunSettings:
    """The paper's choices, at the sizes asked for."""
    settings = profiles.settings_of(options.task, "quick", options.source, seed)
    evolution = dataclasses.replace(settings.evolution, population=options.population, generations=options.generations)
    physics = options.physics or settings.physics
    return dataclasses.replace(
        settings, profile="alternatives", physics=physics, evolution=evolution, episodes=options.episodes
    )


def changed(settings: RunSettings, phase: Phase, name: str) -> RunSettings:
    """The settings with another name in one phase."""
    change = {phase.field: name} | BESIDES.get((phase.room, name), {})
    room = dataclasses.replace(getattr(settings, phase.room), **change)
    return dataclasses.replace(settings, **{phase.room: room})


def do(out: Path, settings: RunSettings) -> dict[tuple[str, str], Run[RunSettings]]:
    """All runs of one seed, by phase and name."""
    paper = runs.create(out / "paper" / f"paper-{settings.seed}", settings)
    for stage in ("evolve", "extract", "learn"):
        table.stage(stage).do(paper)
    done = {}
    for key, phase in PHASES.items():
        done[key, phase.names[0]] = paper
        for name in phase.names[1:]:
            run = runs.create(out / key / f"{name}-{settings.seed}", changed(settings, phase, name))
            for file in phase.shared:
                if not run.file(file).exists():
                    shutil.copy(paper.file(file), run.file(file))
            for stage in phase.stages:
                table.stage(stage).do(run)
            done[key, name] = run
    return done


def final_score(run: Run[RunSettings], method: str) -> float:
    """Best score of an evolution, mean score of the last episodes of Q-learning."""
    scores = source_curve(run, method).scores
    return float(scores[-1] if method == "ER" else scores[-max(1, round(LAST * len(scores))) :].mean())


def markdown(done: list[dict]) -> str:
    """A line per phase and name: quartiles of the final score, and p of Mann-Whitney against the paper's choice."""
    lines = ["| phase | method | final score, median [quartiles] | p |", "|---|---|---|---|"]
    for key, phase in PHASES.items():
        finals = {name: [final_score(seed[key, name], phase.method) for seed in done] for name in phase.names}
        for name, scores in finals.items():
            low, middle, high = np.percentile(scores, [25, 50, 75])
            test = statistics.mann_whitney(np.array(scores), np.array(finals[phase.names[0]]))
            p = f"{test.p_value:.3f}" if name != phase.names[0] else "the paper's"
            lines.append(f"| {phase.title} | `{name}` | {middle:.2f} [{low:.2f}, {high:.2f}] | {p} |")
    return "\n".join(lines)


def draw(done: list[dict], path: Path) -> None:
    """A row per phase: curves (median and quartiles over the seeds) and, beside them, every seed's final score."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, axes = new_figure(len(PHASES), 2, 10, 2.7 * len(PHASES), width_ratios=(3, 2))
        top = top_score(next(iter(done[0].values())), "source")
        for row, (key, phase) in zip(axes, PHASES.items(), strict=True):
            for place, name in enumerate(phase.names):
                colour = "black" if place == 0 else f"C{place - 1}"
                curves = [source_curve(seed[key, name], phase.method) for seed in done]
                _draw_curves(row[0], curves, phase.method, colour, name)
                finals = [final_score(seed[key, name], phase.method) for seed in done]
                row[1].plot(finals, np.full(len(finals), -place), "o", color=colour, alpha=0.5, markersize=5)
                row[1].plot(np.median(finals), -place, "|", color=colour, markersize=16, markeredgewidth=2)
            row[0].set(title=phase.title, ylabel="score", ylim=(0, 1.03 * top))
            row[0].set_xlabel("episodes" if phase.method == "QL" else "episodes (policies evaluated)")
            row[0].grid(axis="y")
            labels = [f"{name} (paper)" if name == phase.names[0] else name for name in phase.names]
            row[1].set_yticks(-np.arange(len(labels)), labels)
            row[1].set(xlim=(0, 1.03 * top), ylim=(0.5 - len(labels), 0.5), xlabel="final score, each seed and median")
        figure.savefig(path, dpi=110)


def _draw_curves(axes, curves: list[Curve], method: str, colour: str, name: str) -> None:
    if method == "QL":
        curves = [moving_mean(curve, WINDOW) for curve in curves]
    grid = common_grid(curves)
    values = np.array([np.interp(grid, curve.episodes, curve.scores) for curve in curves])
    low, middle, high = np.percentile(values, [25, 50, 75], axis=0)
    axes.fill_between(grid, low, high, color=colour, alpha=0.12, linewidth=0)
    axes.plot(grid, middle, color=colour, label=name, linewidth=1.4)


def main() -> int:
    """Run what is missing, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--task", default="box_pushing")
    parser.add_argument("--source", default="A")
    parser.add_argument("--physics", default="", help="default: that of record")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--population", type=int, default=64)
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--episodes", type=int, default=200)
    options = parser.parse_args()
    try:
        done = [do(options.out, settings_of(options, seed)) for seed in range(options.seeds)]
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    text = markdown(done)
    files.write_text(options.out / "alternatives.md", text + "\n")
    print(text)
    draw(done, options.out / "alternatives.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
