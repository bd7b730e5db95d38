"""The stage learn, and Q-learning wherever a run needs it."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from qboot import qlearning
from qboot.envs.task import Domain
from qboot.qlearning import Problem
from qboot.qlearning.learner import EpisodeInfo, LearnerState
from qboot.study.pipeline import loop
from qboot.study.pipeline.loop import Work
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files
from qboot.study.store.artifacts import key_of, read_actions, read_inputs, task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Episodes per compiled call; what is done of it is lost when a stage is killed.
EPISODES_PER_CALL = 10
COLUMNS = ("episode", "score", "discounted_return", "steps", "decisions", "td_error", "largest_q")


class Learning(NamedTuple):
    """A learner and what it has been through."""

    state: LearnerState
    history: dict[str, list]  # COLUMNS of qlearning.csv; scores summed over the domains

    @property
    def episodes(self) -> int:
        """Episodes done."""
        return len(self.history["episode"])


def learn_stage(run: Run[RunSettings], workers: int) -> None:
    """Q-learning on the source set with what was extracted: qlearning.csv, qnets.npz."""
    domains = task_of(run).source_domains(run.settings.source)
    networks = learned(run, domains, "learning", run.settings.episodes, "learn", "qlearning.csv")
    files.write_npz(run.file("qnets.npz"), files.to_arrays(networks))


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
    """
    problem = problem_on(run, domains)
    state = qlearning.init(key_of(run, purpose), problem, networks=networks, episode=episode)
    checkpoint = run.file(f"{name}.checkpoint.npz")
    start = begin(state, checkpoint)

    def step(learning: Learning) -> Learning:
        size = call_size(learning.episodes, n_episodes)
        return after(learning, *qlearning.learn(learning.state, problem, size))

    with Progress(f"{name} {run.label}", "episode", n_episodes, start.episodes) as progress:
        work = Work(
            total=n_episodes,
            done=lambda learning: learning.episodes,
            step=step,
            save=lambda learning: save(learning, checkpoint),
            report=lambda learning: progress.update(learning.episodes, **_figures(learning)),
        )
        end = loop.advance(work, start)
    files.write_csv(run.file(history_name), end.history)
    return end.state.networks


def begin(state: LearnerState, checkpoint: Path) -> Learning:
    """A learner from its first `state`, or from where the checkpoint, if there is one, says."""
    if not checkpoint.exists():
        return Learning(state, {name: [] for name in COLUMNS})
    arrays = files.read_npz(checkpoint)
    history = {name: files.pick(arrays, f"history.{name}", checkpoint).tolist() for name in COLUMNS}
    return Learning(files.like(arrays, state, checkpoint), history)


def save(learning: Learning, checkpoint: Path) -> None:
    """Write a checkpoint."""
    history = {f"history.{name}": np.array(values) for name, values in learning.history.items()}
    files.write_npz(checkpoint, files.to_arrays(learning.state) | history)


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
