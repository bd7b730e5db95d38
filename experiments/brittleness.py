"""How well do policies bear an action at random, and what while learning makes them bear it: ball collecting.

    python experiments/brittleness.py results/brittleness results/standard/ball_collecting/A-? --learners 3

Each variant changes one thing while a learner learns on the source set with what was extracted from a run; all are
then tried in the task as it is, learning nothing more, with a random action in so many of a hundred decisions, on the
source and on the target set (the mean of TRIALS episodes). OUT/scores.csv gets the scores, learner by learner; those
that are in it are not done again. Prints a line of Markdown per variant: means over learners with a 95 % bootstrap
interval over runs.
"""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from experiments.alternatives import read
from experiments.one_at_a_time import with_interval
from qboot import keys, qlearning
from qboot.envs.task import Domain, Task
from qboot.qlearning import Problem
from qboot.study.pipeline.learning import EPISODES_PER_CALL, call_size, problem_on
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files, runs
from qboot.study.store.artifacts import key_of, task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

EXPLORATION = (0.0, 0.01, 0.05, 0.15)
TRIALS = 20
COLUMNS = ("variant", "run", "learner", "episodes", "set", "exploration", "score")

OF_SENSORS = 0.02  # standard deviation, of the range of a sensor
OF_PLACES = 5.0  # units, half of the range
OF_HEADINGS = 0.1  # radians, half of the range


class Noisy(NamedTuple):
    """A task's state, and what is seen of it."""

    observation: jax.Array
    reward: jax.Array
    done: jax.Array
    state: Any
    key: jax.Array


def with_noise_on_sensors(task: Task) -> Task:
    """The task, its sensors with normal noise."""

    def seen(state: Any, key: jax.Array) -> Noisy:
        noise = OF_SENSORS * jax.random.normal(keys.key(key, "noise"), state.observation.shape)
        observation = jnp.clip(state.observation + noise, 0.0, 1.0)
        return Noisy(observation, state.reward, state.done, state, keys.key(key, "next"))

    return task._replace(
        reset=lambda key, domain: seen(task.reset(key, domain), keys.key(key, "sensors")),
        step=lambda domain, noisy, commands: seen(task.step(domain, noisy.state, commands), noisy.key),
        truncated=lambda noisy: task.truncated(noisy.state),
    )


def with_noise_on_starts(task: Task) -> Task:
    """The task, its starts moved and turned a little, uniformly."""

    def moved(key: jax.Array, domain: Domain) -> Domain:
        most = jnp.array([OF_PLACES, OF_PLACES, OF_HEADINGS])
        return domain._replace(start=domain.start + jax.random.uniform(key, (3,), minval=-most, maxval=most))

    return task._replace(reset=lambda key, domain: task.reset(key, moved(keys.key(key, "start"), domain)))


def with_crane_apart(problem: Problem) -> Problem:
    """One action alone opens the crane, the human-designed one that stands still; all extracted ones hold."""
    task, actions = problem.task, jax.tree.map(np.asarray, problem.actions)
    crane, designed = task.effectors.index("crane"), jax.tree.map(np.asarray, task.expert.actions())
    holds = np.arange(len(task.effectors)) == crane
    holding = actions._replace(
        slopes=np.where(holds, 0.0, actions.slopes), intercepts=np.where(holds, 1.0, actions.intercepts)
    )
    opens = designed.intercepts[:, crane] < 0.5
    joined = jax.tree.map(
        lambda some, others: np.concatenate([some, others[opens]]).astype(some.dtype), holding, designed
    )
    return dataclasses.replace(problem, actions=joined)


def with_exploration(problem: Problem) -> Problem:
    """One decision in twenty stays random to the end."""
    return dataclasses.replace(problem, settings=dataclasses.replace(problem.settings, epsilon_end=0.05))


def as_task(change: Callable[[Task], Task]) -> Callable[[Problem], Problem]:
    """The change of a task as one of a problem; each task is changed once, so that its program is compiled once."""
    changed = cache(change)
    return lambda problem: dataclasses.replace(problem, task=changed(problem.task))


VARIANTS: dict[str, Callable[[Problem], Problem]] = {
    "as it is": lambda problem: problem,
    "noise on the sensors": as_task(with_noise_on_sensors),
    "noise on the starts": as_task(with_noise_on_starts),
    "an action of its own for the crane": with_crane_apart,
    "epsilon ends at 0.05": with_exploration,
}


@partial(jax.jit, static_argnames="trials")
def scores_of(networks: Any, key: jax.Array, problem: Problem, exploration: jax.Array, trials: int) -> jax.Array:
    """Scores (trials,) of episodes of acting epsilon-greedily in all domains; nothing is learned."""

    def score(trial: jax.Array) -> jax.Array:
        return jnp.sum(qlearning.evaluate(networks, jax.random.fold_in(key, trial), problem, exploration))

    return lax.map(score, jnp.arange(trials))


def learned(run: Run[RunSettings], problem: Problem, learner: int, episodes: int, label: str) -> Any:
    """The networks of one learner after so many episodes."""
    state = qlearning.init(jax.random.fold_in(key_of(run, "brittleness"), learner), problem)
    with Progress(label, "episode", episodes) as progress:
        for done in range(0, episodes, EPISODES_PER_CALL):
            size = call_size(done, episodes)
            state, info = qlearning.learn(state, problem, size)
            progress.update(done + size, recent=float(info.score.sum(axis=1).mean()))
    return state.networks


def rows_of(run: Run[RunSettings], variant: str, learner: int, episodes: int) -> list[tuple]:
    """What one learner scores in the end: rows of COLUMNS."""
    task, source = task_of(run), run.settings.source
    problem = VARIANTS[variant](problem_on(run, task.source_domains(source)))
    networks = learned(run, problem, learner, episodes, f"{variant}, {run.label}, {learner}")
    rows = []
    for name, domains in (("source", task.source_domains(source)), ("target", task.target_domains(source))):
        tried = dataclasses.replace(problem, task=task, domains=domains)
        for exploration in EXPLORATION:
            key = keys.key(key_of(run, "brittleness"), name)
            score = float(scores_of(networks, key, tried, jnp.float32(exploration), TRIALS).mean())
            rows.append((variant, run.label, learner, episodes, name, exploration, score))
    return rows


def line(variant: str, found: dict) -> str:
    """The line of a variant: its scores by set, by exploration and by run."""
    cells = [
        with_interval(np.array([[of_run["score"].mean()] for of_run in of_runs.values()]))
        for of_set in found.values()
        for of_runs in of_set.values()
    ]
    return f"| {variant} | {' | '.join(cells)} |"


def main(arguments: list[str] | None = None) -> int:
    """Do what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("runs", type=Path, nargs="*", help="runs with finished extractions; none: show what OUT holds")
    parser.add_argument("--learners", type=int, default=1, help="for each run and variant")
    parser.add_argument("--episodes", type=int, default=2_000)
    parser.add_argument("--only", default="", help="variants whose names begin so")
    options = parser.parse_args(arguments)
    path = options.out / "scores.csv"
    try:
        table = files.read_csv(path) if path.exists() else {name: [] for name in COLUMNS}
        if set(table["episodes"]) - {str(options.episodes)} and options.runs:
            raise RunError(f"{path} holds learners of {table['episodes'][0]} episodes: say so, or choose another OUT")
        sources = list(map(runs.load, options.runs))
        for variant in (name for name in VARIANTS if name.startswith(options.only)):
            for learner, run in ((i, run) for i in range(options.learners) for run in sources):
                if (variant, run.label, str(learner)) in zip(*(table[name] for name in COLUMNS[:3]), strict=True):
                    continue
                rows = rows_of(run, variant, learner, options.episodes)
                for name, new in zip(COLUMNS, zip(*rows, strict=True), strict=True):
                    table[name] += map(str, new)
                files.write_csv(path, table)
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if not table["variant"]:
        parser.error(f"{path} is not there yet: name the runs to learn from")
    heads = [f"{name}, {exploration:g}" for name in ("source", "target") for exploration in EXPLORATION]
    print(f"| changed | {' | '.join(heads)} |\n|---{'|---' * len(heads)}|")
    for variant, found in read(path, "variant", "set", "exploration", "run").items():
        print(line(variant, found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
