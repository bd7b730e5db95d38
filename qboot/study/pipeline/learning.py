"""The stage learn, and Q-learning wherever a run needs it."""

import math
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from qboot import qlearning
from qboot.envs.task import Domain
from qboot.qlearning import Problem
from qboot.qlearning.learner import EpisodeInfo, LearnerState
from qboot.qlearning.settings import LearnerSettings
from qboot.study.pipeline import loop
from qboot.study.pipeline.loop import Work
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files, provenance
from qboot.study.store.artifacts import key_of, read_actions, read_inputs, task_of
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Episodes per compiled call; what is done of it is lost when a stage is killed.
EPISODES_PER_CALL = 10
COLUMNS = ("episode", "score", "discounted_return", "steps", "decisions", "td_error", "largest_q")


class Diverged(RunError):
    """A learner's values are no numbers any more."""


class Learning(NamedTuple):
    """A learner and what it has been through."""

    state: LearnerState
    history: dict[str, list]  # COLUMNS of qlearning.csv; scores summed over the domains

    @property
    def episodes(self) -> int:
        """Episodes done."""
        return len(self.history["episode"])


def learn_stage(run: Run[RunSettings], output: Output, workers: int) -> None:
    """Q-learning on the source set with what was extracted: qlearning.csv, qnets.npz."""
    domains = task_of(run).source_domains(run.settings.source)
    networks = learned(run, output, domains, "learning", run.settings.episodes, "learn", "qlearning.csv")
    output.write_npz("qnets.npz", files.to_arrays(networks))


def problem_on(run: Run[RunSettings], domains: Domain) -> Problem:
    """Q-learning in some domains of the run's task, with what was extracted.

    Raises:
        ValueError: if what was extracted does not fit the task or the settings.
    """
    problem = Problem(task_of(run), run.settings.learner, domains, read_actions(run), read_inputs(run))
    qlearning.check_problem(problem)
    return problem


def learned(
    run: Run[RunSettings],
    output: Output,
    domains: Domain,
    purpose: str,
    n_episodes: int,
    name: str,
    history_name: str,
    networks: Any = None,
    episode: int = 0,
) -> Any:
    """Q-learning for `n_episodes`, checkpointed under `name`, its history written when it is over; the networks.

    A learner that goes on from `networks` explores as after the `episode` episodes that these have seen.

    Raises:
        Diverged: if a value is no number any more; the history until then is written.
    """
    problem = problem_on(run, domains)
    state = qlearning.init(key_of(run, purpose), problem, networks=networks, episode=episode)
    checkpoint = f"{name}.checkpoint.npz"
    start = output.restored(checkpoint, partial(restored, state)) or begin(state)

    def step(learning: Learning) -> Learning:
        size = call_size(learning.episodes, n_episodes)
        learning = after(learning, *qlearning.learn(learning.state, problem, size))
        if words := divergence(learning, run.settings.learner):
            keep_diverged(output, history_name, learning)
            raise Diverged(f"{run.folder}: {words}")
        return learning

    with Progress(f"{name} {run.label}", "episode", n_episodes, start.episodes) as progress:
        work = Work(
            total=n_episodes,
            done=lambda learning: learning.episodes,
            step=step,
            save=lambda learning: output.save(checkpoint, saved(learning)),
            report=lambda learning: progress.update(learning.episodes, **_figures(learning)),
        )
        end = loop.advance(work, start)
    output.write_csv(history_name, end.history)
    files.remove(run.file(provenance.diverged_name(history_name)))  # of other settings, then
    return end.state.networks


def begin(state: LearnerState) -> Learning:
    """A learner from its first `state`."""
    return Learning(state, {name: [] for name in COLUMNS})


def saved(learning: Learning) -> dict[str, np.ndarray]:
    """A learner as the arrays of a checkpoint."""
    return files.to_arrays(learning.state) | {f"history.{name}": np.array(v) for name, v in learning.history.items()}


def restored(like: LearnerState, arrays: dict[str, np.ndarray], origin: Path) -> Learning:
    """The learner of a checkpoint, of the shapes of `like`; raises RunError if it is of others."""
    history = {name: files.pick(arrays, f"history.{name}", origin).tolist() for name in COLUMNS}
    return Learning(files.like(arrays, like, origin), history)


def divergence(learning: Learning, settings: LearnerSettings) -> str:
    """When and how a learner diverged, and what to change; empty if all its values are numbers."""
    history = learning.history
    is_number = np.isfinite([history[name] for name in COLUMNS]).all(axis=0)
    if is_number.all() and all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(learning.state.networks)):
        return ""
    numbers = [value for value in history["largest_q"] if math.isfinite(value)]
    episode = history["episode"][int(np.argmin(is_number))] if not is_number.all() else learning.episodes
    return (
        f"Q-learning diverged in episode {episode}, the largest |Q| before was {max(numbers, default=0.0):.3g}: "
        f"begin a run with a smaller --learner.alpha (it is {settings.alpha:g}) in another --out"
    )


def keep_diverged(output: Output, history_name: str, learning: Learning) -> None:
    """Write the history of a learner that diverged, as far as it is numbers; it is no result of the run."""
    is_number = np.isfinite([learning.history[name] for name in COLUMNS]).all(axis=0)
    n = learning.episodes if is_number.all() else int(np.argmin(is_number))
    history = {name: values[:n] for name, values in learning.history.items()}
    files.write_csv(output.run.file(provenance.diverged_name(history_name)), history)


def after(learning: Learning, state: LearnerState, info: EpisodeInfo) -> Learning:
    """The learner after a call that returned `state` and `info` (one entry per episode)."""
    names = COLUMNS[1:5]
    sums = {name: np.asarray(getattr(info, name)).sum(axis=1).tolist() for name in names}
    first, n = learning.episodes + 1, len(info.td_error)
    new = {
        "episode": list(range(first, first + n)),
        **sums,
        "td_error": np.asarray(info.td_error).tolist(),
        "largest_q": np.asarray(info.largest_q).tolist(),
    }
    return Learning(state, {name: learning.history[name] + new[name] for name in COLUMNS})


def call_size(done: int, n_episodes: int) -> int:
    """Episodes of the next call."""
    return min(EPISODES_PER_CALL, n_episodes - done)


def _figures(learning: Learning) -> dict[str, float]:
    scores = learning.history["score"]
    return {"best": max(scores), "recent": float(np.mean(scores[-EPISODES_PER_CALL:]))}
