"""Yardsticks outside the method on the same sparse rewards: Brax's PPO, and evolution alone, by primitive steps.

    python experiments/yardsticks.py results/yardsticks results/standard/box_pushing/A-* --steps 1000000

trains PPO on the source set of each run's task, with the run's seed, and draws its score beside the run's own evolution
and Q-learning, all over the primitive steps that they took. A score is that of one episode, the task's rollouts in
every domain. PPO has Brax's own defaults but for the sizes below, and was not tuned for these tasks. Scores are in
OUT/LABEL.csv; a run that has its file is not trained again. Prints a table in Markdown and writes OUT/yardsticks.png.
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

from qboot.envs import TaskEnv, brax_learners
from qboot.study.analysis.curves import columns, top_score
from qboot.study.figures.drawing import METHOD_COLOURS, METHOD_LABELS, new_figure
from qboot.study.store import files, runs
from qboot.study.store.artifacts import task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run

EVALUATIONS = 10
ENVIRONMENTS = 64
COLOURS = METHOD_COLOURS | {"PPO": "black"}
LABELS = METHOD_LABELS | {"PPO": "PPO (Brax)"}


def rollouts_per_episode(run: Run) -> int:
    """Rollouts of one episode on the source set."""
    task = task_of(run)
    return task.rollouts_per_domain * len(jax.tree.leaves(task.source_domains(run.settings.source))[0])


def ppo(run: Run, n_steps: int) -> dict[str, list]:
    """Primitive steps and scores of PPO as it learns; scores are of its mean actions, domains drawn at random."""
    from brax.training.agents.ppo import train

    brax_learners.mend()
    task, found = task_of(run), {"steps": [], "score": []}

    def note(steps: int, metrics: dict) -> None:
        found["steps"].append(int(steps))
        mean_reward = float(metrics["eval/episode_reward"])
        found["score"].append(mean_reward / task.reward * rollouts_per_episode(run))

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
    return found


def evolution(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Primitive steps so far, and the best score of the population, generation by generation."""
    episodes, lived, best = columns(run, "history.csv", "episodes", "lived", "best")
    steps = np.diff(episodes, prepend=0) * rollouts_per_episode(run) * task_of(run).max_steps * lived
    return np.cumsum(steps), best


def q_learning(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Primitive steps, those of the evolution before it included, and the score of the episode."""
    steps, score = columns(run, "qlearning.csv", "steps", "score")
    return evolution(run)[0][-1] + np.cumsum(steps), score


def main() -> int:
    """Train what is missing, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="+", help="finished runs of one task")
    parser.add_argument("--steps", type=int, default=1_000_000, help="primitive steps of PPO")
    options = parser.parse_args()
    figure, axes = new_figure(1, 1, 7, 4)
    print("| run | method | primitive steps | score at the end | of |\n|---|---|---|---|---|")
    try:
        for place, run in enumerate(runs.load(folder) for folder in options.runs):
            path = options.out / f"{run.label.replace(' ', '_')}.csv"
            if not path.exists():
                files.write_csv(path, ppo(run, options.steps))
            table = files.read_csv(path)
            curves = {
                "PPO": (np.array(table["steps"], float), np.array(table["score"], float)),
                "ER": evolution(run),
                "QL": q_learning(run),
            }
            top = top_score(run, "source")
            for method, (steps, scores) in curves.items():
                last = scores[-max(1, len(scores) // 4) :].mean() if method == "QL" else scores[-1]
                print(f"| {run.label} | {LABELS[method]} | {steps[-1]:,.0f} | {last:.2f} | {top:g} |", flush=True)
                label = LABELS[method] if place == 0 else None
                axes[0, 0].plot(steps, scores, color=COLOURS[method], alpha=0.6, linewidth=1, label=label)
            axes[0, 0].set(xlabel="primitive steps", ylabel="score", ylim=(0, 1.03 * top))
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    axes[0, 0].legend()
    figure.savefig(options.out / "yardsticks.png", dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
