"""Tests played again and recorded state by state: by the best evolved network, and by the greedy Q-policy."""

from typing import Any, NamedTuple

import jax
import numpy as np

from qboot.envs.task import Domain, Task
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.problem import evaluate_individuals
from qboot.neuroevolution.recorders import STATES
from qboot.qlearning import policy
from qboot.study.runs import Run
from qboot.study.stages import (
    key_of,
    read_actions,
    read_inputs,
    read_lineage,
    read_networks,
    source_problem,
    task_of,
)


class Recording(NamedTuple):
    """One test of T steps, as NumPy arrays."""

    domain: Domain
    states: Any  # (T + 1, ...) of the task: before each step, and at the end
    actions: np.ndarray | None  # (T,) int32 action of the Q-learner in force; None for a network


def evolved(run: Run) -> list[Recording]:
    """The best-of-run network in each source domain (its first test there), as it was evaluated at its birth."""
    problem = source_problem(run, workers=1)
    best = read_lineage(run).take(slice(-1, None))
    found = evaluate_individuals(problem, STATES, best, best.births)
    states, finals = found.descriptors
    domains, n_tests = evaluation.rollouts_of(problem.task, problem.domains)
    return [
        Recording(
            _at(domains, test),
            _joined(_at(states, (0, test)), _at(finals, (0, test)), found.steps[0, test]),
            actions=None,
        )
        for test in range(0, n_tests, problem.task.rollouts_per_domain)
    ]


def learned(run: Run) -> list[Recording]:
    """The greedy Q-policy in each source domain (its first test there)."""
    task = task_of(run)
    parts = read_actions(run), read_inputs(run), run.settings.learner
    networks, key = read_networks(run), key_of(run, "tests")
    domains, n_tests = evaluation.rollouts_of(task, task.source_domains(run.settings.source))
    found = []
    for test in range(0, n_tests, task.rollouts_per_domain):
        domain = _at(domains, test)
        played = jax.device_get(policy.rollout(networks, jax.random.fold_in(key, test), task, domain, *parts))
        steps = int(played.mask.sum())
        found.append(Recording(domain, _joined(played.states, played.final, steps), np.asarray(played.actions[:steps])))
    return found


def scores(task: Task, recording: Recording) -> np.ndarray:
    """Rewards earned so far, (T + 1,), in units of the task's reward."""
    return np.cumsum(recording.states.reward) / task.reward


def _joined(states: Any, final: Any, steps: int) -> Any:
    """The first `steps` of states (T, ...) and the final one."""
    return jax.tree.map(lambda many, last: np.concatenate([many[:steps], last[None]]), states, final)


def _at(tree: Any, index: int | tuple[int, ...]) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], tree)
