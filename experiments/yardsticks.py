"""Yardsticks outside the method on the same sparse rewards: Brax's PPO, and evolution alone, by primitive steps.

    python experiments/yardsticks.py results/yardsticks results/standard/box_pushing/A-*

Evolution goes on, with the run's seed, until it has taken as many primitive steps as the run's evolution and Q-learning
together; PPO is trained for as many (or for `--steps`) on the source set of the run's task, with the run's seed. A
score is that of one episode, the task's rollouts in every domain: of evolution's best network in twenty fresh episodes,
of PPO's mean actions in 64 rollouts, and of Q-learning, which explores, over the last quarter of its episodes. PPO has
Brax's own defaults but for the sizes below, and was not tuned for these tasks.

OUT/scores.csv holds the scores at the end and OUT/curves.csv the scores on the way; a run that is in OUT is not done
again. Prints a table in Markdown and writes OUT/yardsticks.png.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import jax
import matplotlib
import numpy as np
from matplotlib.ticker import StrMethodFormatter

from experiments.alternatives import LAST, WINDOW, draw_finals, final_score, read, told_against, told_alone
from qboot.envs import TaskEnv, brax_learners
from qboot.study.analysis.curves import Curve, columns, moving_mean, top_score
from qboot.study.figures.drawing import METHOD_COLOURS, STYLE, new_figure
from qboot.study.pipeline import table
from qboot.study.store import files, runs
from qboot.study.store.artifacts import task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

EVALUATIONS = 10
ENVIRONMENTS = 64
METHODS = {"QL": "the method", "ER": "evolution alone", "PPO": "PPO (Brax)"}
COLOURS = METHOD_COLOURS | {"PPO": "black"}
SCORES, CURVES = ("method", "seed", "steps", "score", "top"), ("method", "seed", "steps", "score")
Steps = tuple[np.ndarray, np.ndarray]  # primitive steps so far, and scores


def rollouts_per_episode(run: Run[RunSettings]) -> int:
    """Rollouts of one episode on the source set."""
    task = task_of(run)
    return task.rollouts_per_domain * len(jax.tree.leaves(task.source_domains(run.settings.source))[0])


def ppo(run: Run[RunSettings], n_steps: int) -> Steps:
    """PPO as it learns; scores are of its mean actions in ENVIRONMENTS rollouts, domains drawn at random."""
    from brax.training.agents.ppo import train

    brax_learners.mend()
    task = task_of(run)
    found: list[tuple[int, float]] = []

    def note(steps: int, metrics: dict) -> None:
        mean_reward = float(metrics["eval/episode_reward"])
        found.append((int(steps), mean_reward / task.reward * rollouts_per_episode(run)))

    train.train(
        TaskEnv(task, domains="source", source=run.settings.source, action_range=(-1.0, 1.0)),
        num_timesteps=n_steps,
        episode_length=task.max_steps,
        num_envs=ENVIRONMENTS,
        num_eval_envs=ENVIRONMENTS,
        num_evals=EVALUATIONS,
        batch_size=ENVIRONMENTS,
        num_minibatches=4,
        unroll_length=20,
        discounting=run.settings.learner.gamma,
        deterministic_eval=True,
        seed=run.settings.seed,
        progress_fn=note,
    )
    steps, scores = zip(*found, strict=True)
    return np.array(steps), np.array(scores)


def evolution(run: Run[RunSettings]) -> Steps:
    """The best score of the population, generation by generation."""
    episodes, lived, best = columns(run, "history.csv", "episodes", "lived", "best")
    steps = np.diff(episodes, prepend=0) * rollouts_per_episode(run) * task_of(run).max_steps * lived
    return np.cumsum(steps), best


def q_learning(run: Run[RunSettings]) -> Steps:
    """The score of the episode, after the steps of the evolution before it."""
    steps, score = columns(run, "qlearning.csv", "steps", "score")
    return evolution(run)[0][-1] + np.cumsum(steps), score


def longer(run: Run[RunSettings], n_steps: float, folder: Path) -> Run[RunSettings]:
    """The run's evolution, in another folder, for about `n_steps` primitive steps."""
    generations = round(run.settings.evolution.generations * n_steps / evolution(run)[0][-1])
    settings = dataclasses.replace(
        run.settings, evolution=dataclasses.replace(run.settings.evolution, generations=generations)
    )
    new = runs.create(folder, settings)
    table.stage("evolve").do(new)
    return new


def compare(run: Run[RunSettings], out: Path, n_steps: int) -> None:
    """Write the two tables of one run into a folder."""
    learned = q_learning(run)
    alone = longer(run, learned[0][-1], out / "evolution")
    curves = {"QL": learned, "ER": evolution(alone), "PPO": ppo(run, n_steps or int(learned[0][-1]))}
    finals = {
        "QL": float(learned[1][-max(1, round(LAST * len(learned[1]))) :].mean()),
        "ER": final_score(alone, "ER"),
        "PPO": curves["PPO"][1][-1],
    }
    seed, top = run.settings.seed, top_score(run, "source")
    rows = [
        (name, seed, float(at), float(score))
        for name, curve in curves.items()
        for at, score in zip(*curve, strict=True)
    ]
    files.write_csv(out / "curves.csv", _columns(CURVES, rows))
    rows = [(name, seed, float(curves[name][0][-1]), float(score), top) for name, score in finals.items()]
    files.write_csv(out / "scores.csv", _columns(SCORES, rows))


def _columns(names: tuple[str, ...], rows: list[tuple]) -> dict[str, list]:
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


def _joined(paths: list[Path]) -> dict[str, list]:
    tables = list(map(files.read_csv, paths))
    return {name: [value for each in tables for value in each[name]] for name in tables[0]}


def markdown(scores: dict) -> str:
    """A line per method: steps, median and quartiles of the final score, and the test against the method."""
    lines = ["| | n | primitive steps | median [95 %] | quartiles | A12 | p |", "|---|---|---|---|---|---|---|"]
    for name, found in scores.items():
        values = found["score"]
        told = told_against(values, scores["QL"]["score"]) if name != "QL" else "| "
        steps = f"{np.median(found['steps']):,.0f}"
        lines.append(f"| {METHODS[name]} | {len(values)} | {steps} | {told_alone(values)} | {told} |")
    return "\n".join(lines)


def draw(scores: dict, curves: dict, path: Path) -> None:
    """Every run as it learns, by primitive steps (Q-learning after its evolution), and beside it the final scores."""
    with matplotlib.rc_context(STYLE):
        figure, [[left, right]] = new_figure(1, 2, 11, 3.4, width_ratios=(3, 2))
        for name, found in curves.items():
            for seed in np.unique(found["seed"]):
                mine = found["seed"] == seed
                curve = Curve(found["steps"][mine], found["score"][mine])
                curve = moving_mean(curve, WINDOW) if name == "QL" else curve
                left.plot(*curve, color=COLOURS[name], alpha=0.45, linewidth=1)
        top = scores["QL"]["top"][0]
        left.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        left.set(xlabel="primitive steps", ylabel="score", ylim=(-0.03 * top, 1.03 * top))
        draw_finals(
            right,
            {METHODS[name]: found["score"] for name, found in scores.items()},
            top,
            [COLOURS[name] for name in scores],
        )
        figure.savefig(path, dpi=110)


def main(arguments: list[str] | None = None) -> int:
    """Do what is missing, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="*", help="finished runs of one task; none: draw what OUT holds")
    parser.add_argument("--steps", type=int, default=0, help="primitive steps of PPO; default as many as the method")
    options = parser.parse_args(arguments)
    out = options.out
    try:
        folders = []
        for run in map(runs.load, options.runs):
            folders.append(out / run.label.replace(" ", "_"))
            if not (folders[-1] / "scores.csv").exists():
                compare(run, folders[-1], options.steps)
        for name in ("scores.csv", "curves.csv") if folders else ():
            files.write_csv(out / name, _joined([folder / name for folder in folders]))
        scores, curves = (read(out / name, "method") for name in ("scores.csv", "curves.csv"))
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    print(markdown(scores))
    draw(scores, curves, out / "yardsticks.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
