"""Rollouts played again and recorded state by state: by the best evolved network, and by the greedy Q-policy."""

from typing import Any, NamedTuple

import jax
import numpy as np

from qboot import qlearning
from qboot.envs.task import Domain, Task
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.problem import evaluate_individuals, evaluation_keys
from qboot.neuroevolution.recorders import STATES
from qboot.study.pipeline.evolving import source_problem
from qboot.study.pipeline.learning import problem_on as learning_problem
from qboot.study.store.artifacts import read_lineage, read_networks, task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class Recording(NamedTuple):
    """One rollout of T timesteps, as NumPy arrays."""

    domain: Domain
    states: Any  # (T + 1, ...) of the task: before each step, and at the end
    actions: np.ndarray  # (T,) int32 action of the Q-learner in force; (0,) for a network


def evolved(run: Run[RunSettings]) -> list[Recording]:
    """The best-of-run network in each rollout of an episode on the source set, as it was evaluated at its birth."""
    problem = source_problem(run, workers=1)
    best = read_lineage(run).take(slice(-1, None))
    found = evaluate_individuals(problem, STATES, best, best.births, int(best.rooms[0]))
    states, finals = found.descriptors
    domains, n_rollouts = evaluation.rollouts_of(problem.task, problem.domains)
    return [
        Recording(
            _at(domains, index),
            _joined(_at(states, (0, index)), _at(finals, (0, index)), int(found.steps[0, index])),
            actions=np.empty(0, np.int32),
        )
        for index in range(n_rollouts)
    ]


def learned(run: Run[RunSettings]) -> list[Recording]:
    """The greedy Q-policy in each rollout of an episode on the source set, from the starts that `evolved` has."""
    task = task_of(run)
    problem = learning_problem(run, task.source_domains(run.settings.source))
    best = read_lineage(run).take(slice(-1, None))
    [key] = evaluation_keys(source_problem(run, workers=1), best, best.births)
    networks = read_networks(run, problem)
    found = []
    for index in range(problem.n_rollouts):
        domain = problem.domain(problem.place(index))
        played = jax.device_get(qlearning.rollout(networks, jax.random.fold_in(key, index), problem, domain))
        steps = int(played.mask.sum())
        found.append(Recording(domain, _joined(played.states, played.final, steps), np.asarray(played.actions[:steps])))
    return found


def first_of_domains(task: Task, found: list[Recording]) -> list[Recording]:
    """The first rollout in each domain."""
    return found[:: task.rollouts_per_domain]


def scores(task: Task, recording: Recording) -> np.ndarray:
    """Rewards earned so far, (T + 1,), in units of the task's reward."""
    return np.cumsum(recording.states.reward) / task.reward


def _joined(states: Any, final: Any, steps: int) -> Any:
    """The first `steps` of states (T, ...) and the final one."""
    return jax.tree.map(lambda many, last: np.concatenate([many[:steps], last[None]]), states, final)


def _at(tree: Any, index: int | tuple[int, ...]) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], tree)
