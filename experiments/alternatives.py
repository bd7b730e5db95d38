"""Other methods beside the paper's in each phase: the same task, budget and seeds, and a panel per phase.

    python experiments/alternatives.py results/alternatives --task box_pushing --physics kinematic --seeds 10

Every seed has a run with the paper's choices. An alternative shares with it all that comes before its phase, copied
from its folder, and differs in one name. Runs are in OUT/PHASE/NAME-SEED; finished ones are not run again, an
interrupted one goes on. After each seed OUT/scores.csv and OUT/curves.csv hold what there is. At the end, or with
`--seeds 0` at once, the two are told as a table in Markdown and drawn as OUT/scores.png and OUT/curves.png.
"""

import argparse
import dataclasses
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import jax
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qboot.extraction.clustering import CLUSTERINGS
from qboot.extraction.segmentation import SEGMENTATIONS
from qboot.extraction.sensors import SELECTIONS
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.evaluation import evaluate_all
from qboot.qlearning import LEARNERS
from qboot.study.analysis import statistics
from qboot.study.analysis.curves import columns, common_grid, moving_mean, source_curve, top_score
from qboot.study.figures.drawing import STYLE, grid_of, side_by_side
from qboot.study.pipeline import profiles, table
from qboot.study.store import files, runs
from qboot.study.store.artifacts import key_of, read_lineage, task_of
from qboot.study.store.files import RunError
from qboot.study.store.provenance import RECORD
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

EVOLVED = ("history.csv", "lineage.npz", "pareto.npz")
EXTRACTED = ("actions.npz", "sensors.npz")
WINDOW = 20  # episodes of Q-learning that a curve is a mean over
LAST = 1 / 4  # of the episodes, the final score is the mean over
POINTS = 120  # of a curve, at most
FRESH = 20  # episodes that the best network of an evolution is scored by


class Phase(NamedTuple):
    """One phase of the method, and who competes in it."""

    title: str  # of the panel; phases of one title share it
    room: str  # of the settings
    field: str  # whose value is the name
    names: tuple[str, ...]  # the paper's choice first
    shared: tuple[str, ...]  # files of the stages before it
    stages: tuple[str, ...]
    method: str  # whose curve tells


PHASES = {
    "search": Phase("Policy search", "evolution", "algorithm", tuple(ALGORITHMS), (), ("evolve",), "ER"),
    "segmentation": Phase(
        "Actions", "actions", "segmentation", tuple(SEGMENTATIONS), EVOLVED, ("extract", "learn"), "QL"
    ),
    "clustering": Phase("Actions", "actions", "clustering", tuple(CLUSTERINGS), EVOLVED, ("extract", "learn"), "QL"),
    "sensors": Phase("Sensors", "sensors", "selection", tuple(SELECTIONS), EVOLVED, ("extract", "learn"), "QL"),
    "learner": Phase("Learners", "learner", "algorithm", tuple(LEARNERS), (*EVOLVED, *EXTRACTED), ("learn",), "QL"),
}
# What a name needs besides itself, said where the results are: fitted Q learns from kept trajectories alone.
BESIDES = {("learner", "fitted_q"): {"eta": 10}, ("learner", "adam"): {"alpha": 0.001}}


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


def with_generations(settings: RunSettings, paper: Run[RunSettings]) -> RunSettings:
    """As many generations as the evaluations of the paper's choice suffice for."""
    episodes = int(columns(paper, "history.csv", "episodes")[0][-1])
    # Samples, their mean and, where starts are random, the best so far.
    each = settings.evolution.population + 1 + settings.evolution.reevaluate
    return dataclasses.replace(
        settings, evolution=dataclasses.replace(settings.evolution, generations=episodes // each - 1)
    )


def do(out: Path, settings: RunSettings, phases: list[str]) -> dict[tuple[str, str], Run[RunSettings]]:
    """All runs of one seed, by phase and name."""
    paper = runs.create(out / "paper" / f"paper-{settings.seed}", settings)
    for stage in ("evolve", "extract", "learn"):
        table.stage(stage).do(paper)
    done = {}
    for key, phase in ((key, PHASES[key]) for key in phases):
        done[key, phase.names[0]] = paper
        for name in phase.names[1:]:
            other = changed(settings, phase, name)
            if key == "search":
                other = with_generations(other, paper)
            run = runs.create(out / key / f"{name}-{settings.seed}", other)
            if not run.file(RECORD).exists():
                # The record last: without it, nothing that was copied is believed.
                for file in (*phase.shared, *([RECORD] if phase.shared else [])):
                    shutil.copy(paper.file(file), run.file(file))
            for stage in phase.stages:
                table.stage(stage).do(run)
            done[key, name] = run
    return done


def final_score(run: Run[RunSettings], method: str) -> float:
    """Mean score of the best network in fresh episodes, or of the last episodes of Q-learning."""
    if method == "QL":
        scores = source_curve(run, method).scores
        return float(scores[-max(1, round(LAST * len(scores))) :].mean())
    task, best = task_of(run), read_lineage(run).genomes
    genomes = jax.tree.map(lambda leaf: np.repeat(leaf[-1:], FRESH, axis=0), best)
    fresh = jax.random.split(key_of(run, "fresh"), FRESH)
    recorder = DISTANCES["adhoc"].recorder
    domains = task.source_domains(run.settings.source)
    return float(
        evaluate_all(task, run.settings.dnn, recorder, domains, genomes, fresh, workers=1).scores.sum(axis=1).mean()
    )


def note(out: Path, done: list[dict[tuple[str, str], Run[RunSettings]]]) -> None:
    """Write OUT/scores.csv, the final score of every run, and OUT/curves.csv, quartiles over the seeds."""
    scores: dict[str, list] = {name: [] for name in ("phase", "method", "seed", "score", "top")}
    curves: dict[str, list] = {name: [] for name in ("phase", "method", "episodes", "lower", "median", "upper")}
    for key, name in done[0]:
        some = [of_seed[key, name] for of_seed in done]
        method = PHASES[key].method
        for run in some:
            row = key, name, run.settings.seed, final_score(run, method), top_score(run, "source")
            for column, value in zip(scores, row, strict=True):
                scores[column].append(value)
        found = [source_curve(run, method) for run in some]
        found = [moving_mean(curve, WINDOW) for curve in found] if method == "QL" else found
        grid = common_grid(found, POINTS)
        for at, *quartiles in zip(grid, *statistics.median_and_quartiles(found, grid), strict=True):
            for column, value in zip(curves, (key, name, int(at), *map(float, quartiles)), strict=True):
                curves[column].append(value)
    files.write_csv(out / "scores.csv", scores)
    files.write_csv(out / "curves.csv", curves)


def read(path: Path, *names: str) -> dict:
    """The numbers of a table by the values of the columns `names`, one within the other, then by column."""
    return _grouped(files.read_csv(path), names)


def _grouped(table: dict[str, list[str]], names: tuple[str, ...]) -> dict:
    if not names:
        return {column: np.array(values, float) for column, values in table.items()}
    first, *others = names
    found = {}
    for value in dict.fromkeys(table[first]):
        kept = [place for place, other in enumerate(table[first]) if other == value]
        rows = {column: [values[place] for place in kept] for column, values in table.items() if column != first}
        found[value] = _grouped(rows, tuple(others))
    return found


def markdown(scores: dict) -> str:
    """A line per phase and name: median and quartiles of the final score, and the test against the paper's choice."""
    lines = ["| phase | method | n | median [95 %] | quartiles | A12 | p |", "|---|---|---|---|---|---|---|"]
    for key, methods in scores.items():
        for name, found in methods.items():
            paper = PHASES[key].names[0]
            told = told_against(found["score"], methods[paper]["score"]) if name != paper else "| the paper's"
            lines.append(f"| {key} | `{name}` | {len(found['score'])} | {told_alone(found['score'])} | {told} |")
    return "\n".join(lines)


def told_alone(scores: np.ndarray) -> str:
    """Two cells of a table: median with its 95 % interval, quartiles."""
    low, middle, high = np.percentile(scores, [25, 50, 75])
    bounds = "[{:.2f}, {:.2f}]".format(*statistics.median_interval(scores))
    return f"{middle:.2f} {bounds} | {low:.2f} to {high:.2f}"


def told_against(scores: np.ndarray, others: np.ndarray) -> str:
    """Two cells of a table: A12 and p of the Mann-Whitney test."""
    test = statistics.mann_whitney(scores, others)
    return f"{test.a12:.2f} | {test.p_value:.3f}"


def panels(found: dict) -> dict[str, dict[str, dict]]:
    """The numbers of those in each panel by their labels; the paper's choice is first, and there once."""
    by_title: dict[str, dict[str, dict]] = {}
    for key, methods in found.items():
        paper, *others = methods
        by_title.setdefault(PHASES[key].title, {"the paper's": methods[paper]}).update({o: methods[o] for o in others})
    return by_title


def colour(place: int) -> str:
    """Of a method by its place in a panel."""
    return "black" if place == 0 else f"C{place - 1}"


def draw_scores(scores: dict) -> Figure:
    """A panel per phase: every seed's final score, the median and its 95 % interval."""
    by_title = panels(scores)
    figure, axes = grid_of(len(by_title), 2, 5.5, 2.9)
    for panel, (title, some) in zip(axes, by_title.items(), strict=True):
        top = some["the paper's"]["top"][0]
        values = {label: numbers["score"] for label, numbers in some.items()}
        draw_finals(panel, values, top, [colour(place) for place in range(len(some))])
        panel.set_title(title)
    return figure


def draw_finals(panel: Axes, scores: dict[str, np.ndarray], top: float, colours: list[str]) -> None:
    """A row for each of those who have scores (n,): a dot for each, the median and its 95 % interval."""
    for place, (values, its) in enumerate(zip(scores.values(), colours, strict=False)):
        offsets = side_by_side(len(values), 0.4)
        panel.plot(values, place + offsets, "o", color=its, alpha=0.35, markersize=4, markeredgewidth=0)
        panel.plot(statistics.median_interval(values), (place, place), color=its, linewidth=2.5)
        panel.plot(np.median(values), place, "o", color=its, markersize=8)
    panel.set_yticks(range(len(scores)), list(scores))
    n = min(map(len, scores.values()))
    panel.set(ylim=(len(scores) - 0.5, -0.5), xlim=(-0.03 * top, 1.03 * top))
    panel.set_xlabel(f"final score, of {top:g}; n = {n}")
    panel.grid(axis="x")


def draw_curves(curves: dict) -> Figure:
    """A panel per phase: medians over the seeds as they learn, and quartiles."""
    by_title = panels(curves)
    figure, axes = grid_of(len(by_title), 2, 5.5, 3.4)
    for panel, (title, some) in zip(axes, by_title.items(), strict=True):
        for place, (label, of) in enumerate(some.items()):
            panel.fill_between(of["episodes"], of["lower"], of["upper"], color=colour(place), alpha=0.1, linewidth=0)
            panel.plot(of["episodes"], of["median"], color=colour(place), label=label, linewidth=1.5)
        panel.set(title=title, xlabel="episodes", ylabel="score")
        panel.set_ylim(bottom=0)
        panel.grid(axis="y")
        panel.legend(fontsize=8)
    return figure


def tell(out: Path) -> None:
    """Print the table, draw the figures."""
    scores = read(out / "scores.csv", "phase", "method")
    text = markdown(scores)
    files.write_text(out / "scores.md", text + "\n")
    print(text)
    with matplotlib.rc_context(STYLE):
        draw_scores(scores).savefig(out / "scores.png", dpi=110)
        draw_curves(read(out / "curves.csv", "phase", "method")).savefig(out / "curves.png", dpi=110)


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, print the table, draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--task", default="box_pushing")
    parser.add_argument("--source", default="A")
    parser.add_argument("--physics", default="", help="default: that of record")
    parser.add_argument("--phases", nargs="+", choices=PHASES, default=list(PHASES))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--population", type=int, default=64)
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--episodes", type=int, default=200)
    options = parser.parse_args(arguments)
    try:
        done = []
        for seed in range(options.seeds):
            done.append(do(options.out, settings_of(options, seed), options.phases))
            note(options.out, done)
        tell(options.out)
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
