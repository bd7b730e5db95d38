"""Benchmarks of the parts of an episode of Q-learning, and of the machine itself; `bench.py` runs them."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qboot import qlearning
from qboot.envs import get_task
from qboot.extraction.actions import ActionSet
from qboot.qlearning import LearnerState, Problem
from qboot.qlearning.smdp import primitive_step, start_rollout
from qboot.study.pipeline.profiles import defaults_of

ACTION_DURATION = 20  # steps, of every action here
KEPT_RETURN = 1e6  # of the stored trajectories: no rollout replaces them


def least_seconds(function: Callable, *arguments: Any, repeats: int = 3) -> float:
    """The least seconds of a core that a call of a compiled function takes; the first, which compiles, is not counted.

    Seconds of a core, not of a clock: one thread does the work, and others may want the cores.
    """
    jax.block_until_ready(function(*arguments))
    seconds = []
    for _ in range(repeats):
        started = time.process_time()
        jax.block_until_ready(function(*arguments))
        seconds.append(time.process_time() - started)
    return min(seconds)


def calibration() -> dict[str, float]:
    """What the machine can do whatever the project does: a matrix product, and one thread's loop of fixed work."""
    n, n_steps = 1024, 100_000
    matrix = jax.random.normal(jax.random.key(0), (n, n))
    product = least_seconds(jax.jit(lambda a: a @ a), matrix, repeats=10)

    @jax.jit
    def loop(start: jax.Array) -> jax.Array:
        return jax.lax.fori_loop(0, n_steps, lambda _, x: jnp.tanh(x * 1.01 + 0.1), start)

    scan = least_seconds(loop, jnp.linspace(0.0, 1.0, 64), repeats=10)
    return {"product_gflops_per_core": 2e-9 * n**3 / product, "loop_us_per_step": 1e6 * scan / n_steps}


def made_up_problem(name: str, physics: str | None, n_actions: int, n_inputs: int, hidden: int) -> Problem:
    """Random actions of one duration, and random sensors, on the source set."""
    task = get_task(name, physics)
    settings = replace(defaults_of(task).learner, hidden=hidden)
    random = np.random.default_rng(0)
    shape = n_actions, len(task.effectors)
    actions = ActionSet(
        slopes=jnp.zeros(shape),
        intercepts=jnp.asarray(random.uniform(0.2, 0.8, shape), jnp.float32),
        durations=jnp.full(n_actions, ACTION_DURATION),
    )
    selected = np.zeros(settings.lags * len(task.sensors), bool)
    selected[random.choice(selected.size, n_inputs, replace=False)] = True
    inputs = qlearning.input_set(selected.reshape(settings.lags, -1))
    return Problem(task, settings, task.source_domains("A"), actions, inputs)


def full_store(state: LearnerState, problem: Problem, length: int) -> LearnerState:
    """A learner whose store holds made-up trajectories of `length` transitions, which stay."""
    store, random = state.store, np.random.default_rng(0)
    return state._replace(
        store=store._replace(
            inputs=jnp.asarray(random.uniform(size=store.inputs.shape), jnp.float32),
            actions=jnp.asarray(random.integers(problem.n_actions, size=store.actions.shape), jnp.int32),
            rewards=store.rewards._replace(discount=jnp.full_like(store.rewards.discount, 0.98)),
            length=jnp.full_like(store.length, min(length, store.actions.shape[-1])),
            discounted_return=jnp.full_like(store.discounted_return, KEPT_RETURN),
        )
    )


def episode(name: str, n_actions: int, n_inputs: int, hidden: int, physics: str | None = None) -> dict[str, float]:
    """Microseconds of the parts of an episode: a step, the values of a state, a decision, a replayed transition.

    A decision is what an episode without replay takes beyond its steps. One thread.
    """
    problem = made_up_problem(name, physics, n_actions, n_inputs, hidden)
    # The robot stands still, lest a rollout end: what a step then costs is not what one costs in an episode.
    still = replace(
        problem, actions=problem.actions._replace(intercepts=jnp.full_like(problem.actions.intercepts, 0.5))
    )
    task, n_steps = problem.task, 10_000

    @jax.jit
    def steps(problem: Problem) -> Any:
        domain = problem.domain(0)
        start = start_rollout(jax.random.key(0), problem, domain)
        return jax.lax.fori_loop(
            0, n_steps, lambda t, smdp: primitive_step(problem, domain, t % n_actions, t, smdp), start
        )

    states = jax.random.uniform(jax.random.key(0), (1_000, n_inputs))
    values = jax.jit(lambda networks: jax.lax.map(partial(problem.learner.values, networks), states))
    state = qlearning.init(jax.random.key(0), problem)
    without_replay = Problem(task, replace(problem.settings, eta=0), problem.domains, problem.actions, problem.inputs)
    idle = qlearning.init(jax.random.key(0), without_replay)
    full = full_store(state, problem, task.max_steps // ACTION_DURATION)
    replay = jax.jit(
        lambda networks, key, store: problem.learner.replay(
            networks, key, store, problem.action_mask, problem.settings.alpha
        )
    )

    _, info = qlearning.learn(idle, without_replay, 1)
    step_us = 1e6 * least_seconds(steps, still) / n_steps
    acting_us = 1e6 * least_seconds(qlearning.learn, idle, without_replay, 1)
    replay_us = 1e6 * least_seconds(replay, full.networks, jax.random.key(0), full.store)
    return {
        "actions": n_actions,
        "inputs": n_inputs,
        "hidden": hidden,
        "step_us": step_us,
        "values_us": 1e6 * least_seconds(values, full.networks) / len(states),
        "decision_us": (acting_us - step_us * int(info.steps.sum())) / int(info.decisions.sum()),
        "replayed_us": replay_us / int(full.store.length.sum()),
    }
