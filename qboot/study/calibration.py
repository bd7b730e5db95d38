"""Measuring on this machine what a study's parts cost; most of the time that it takes is compiling."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from qboot import qlearning
from qboot.envs.task import Task
from qboot.extraction.baselines import random_actions, random_sensors
from qboot.neuroevolution import dnn, evaluation
from qboot.neuroevolution.distances import DISTANCES
from qboot.qlearning import Problem, input_set
from qboot.qlearning.learner import LearnerState
from qboot.study.controls.conditions import LAGS
from qboot.study.costs import n_selected
from qboot.study.pipeline.episode import n_rollouts, n_weights
from qboot.study.pipeline.profiles import Costs, defaults_of

REPEATS = 5
REPLAYED = 500  # transitions of each kept trajectory, in the measurement of updates


def measure(task: Task, n_steps: int) -> Costs:
    """The costs of a task with rollouts of `n_steps` on this machine."""
    task = task._replace(max_steps=n_steps)
    defaults, domains = defaults_of(task), task.source_domains(task.sources[0])
    rollout_steps = n_rollouts(task, domains) * n_steps
    # A block of the first generation, as evolution evaluates it.
    keys, recorder = jax.random.split(jax.random.key(0), evaluation.BLOCK), DISTANCES["hamming"].recorder
    genomes = jax.vmap(dnn.random_genome, in_axes=(0, None))(keys, defaults.dnn)
    evaluate = partial(evaluation.evaluate_all, task, defaults.dnn, recorder, domains, genomes, keys, workers=1)
    compile_evolution, block = _timed(evaluate)
    lived = int(evaluate().steps.sum())
    # An episode with random actions, of which nothing is replayed.
    most = LAGS * len(task.sensors)
    small = _problem(task, defaults.actions.n_actions, round(min(n_selected(task, defaults), most / 2)))
    state = qlearning.init(jax.random.key(0), small)
    compile_learning, episode = _timed(lambda: qlearning.learn(state, small, 1))
    info = qlearning.learn(state, small, 1)[1]
    steps, decisions = int(info.steps.sum()), int(info.decisions.sum())
    # Replays alone, with networks of two sizes, both so small that XLA keeps them to one thread: larger ones it spreads
    # over all that are idle, and what several threads cost would be taken for the cost of the size.
    large = _problem(task, defaults.actions.n_actions, most)
    of_small, of_large = _update_seconds(small), _update_seconds(large)
    weight = (of_large - of_small) / (_n_weights(large) - _n_weights(small))
    return Costs(
        start=defaults.usual_costs.start,
        compile_evolution=compile_evolution,
        compile_learning=compile_learning,
        rollout_step=block / lived,
        acting_step=max(episode - decisions * of_small, 0.0) / steps,
        update=max(of_small - weight * _n_weights(small), 0.0),
        weight=weight,
        lived=steps / rollout_steps,
        lived_evolving=defaults.usual_costs.lived_evolving,
    )


def _problem(task: Task, n_actions: int, n_inputs: int) -> Problem:
    """Q-learning with actions and inputs drawn at random."""
    defaults = defaults_of(task)
    durations = defaults.actions.min_duration, defaults.actions.max_duration
    actions = jax.tree.map(jnp.asarray, random_actions(0, n_actions, len(task.effectors), durations))
    inputs = input_set(random_sensors(0, LAGS, len(task.sensors), n_inputs))
    return Problem(task, defaults.learner, task.source_domains(task.sources[0]), actions, inputs)


def _n_weights(problem: Problem) -> float:
    return n_weights(problem.n_actions, problem.n_inputs, problem.settings.hidden)


def _update_seconds(problem: Problem) -> float:
    """Core-seconds of an update: of replaying a store that is full of trajectories of nothing."""
    state: LearnerState = qlearning.init(jax.random.key(0), problem, capacity=REPLAYED)
    store = state.store._replace(length=jnp.full_like(state.store.length, REPLAYED))
    replay = jax.jit(
        lambda networks, store: problem.learner.replay(
            networks, jax.random.key(0), store, problem.action_mask, problem.settings.alpha
        )
    )
    return _timed(lambda: replay(state.networks, store))[1] / int(store.length.sum())


def _timed(call: Callable[[], Any]) -> tuple[float, float]:
    """Core-seconds of compiling, and the least of a call after that."""
    seconds = []
    for _ in range(1 + REPEATS):
        started = time.process_time()
        jax.block_until_ready(call())
        seconds.append(time.process_time() - started)
    first, *others = seconds
    return first - min(others), min(others)
