"""Tiny tasks whose optimal values are known, and actions to learn them with."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.task import Task
from qboot.extraction.actions import ActionSet
from qboot.qlearning import LearnerSettings, Problem, input_set

CELLS = 6
REWARD = 10.0
RANDOM = -1
# Right for 1 step, right for 3, left for 2, and one that slows down: right, right, stay, stay.
SLOPES, INTERCEPTS, DURATIONS = np.array([0, 0, 0, -0.2]), np.array([1, 1, 0, 1.0]), np.array([1, 3, 2, 4])
SETTINGS = LearnerSettings(gamma=0.9, alpha=0.1, hidden=16, lags=2)


class ToyState(NamedTuple):
    observation: jax.Array
    reward: jax.Array
    done: jax.Array
    where: jax.Array  # () int32


def toy_task(name, sensors, max_steps, reward, reset, step, domains, rollouts_per_domain=1):
    return Task(
        name=name,
        sensors=tuple(f"sensor {i}" for i in range(sensors)),
        effectors=("drive",),
        sources=("A",),
        max_steps=max_steps,
        rollouts_per_domain=rollouts_per_domain,
        max_score_per_domain=rollouts_per_domain,
        reward=reward,
        reset=reset,
        step=step,
        truncated=lambda state: jnp.array(False),
        source_domains=lambda source: domains,
        target_domains=lambda source: domains,
        position=lambda domain, state: state.where,
        outcome=lambda domain, state: state.where[None].astype(jnp.float32),
        trajectory_period=1,
    )


# Corridor: cells in a row; a domain is (goal, start), int32. The drive goes right above 2/3, left below 1/3.
# Reaching the goal pays once and ends the test. The sensors are the cell, one-hot, and "the goal is cell 0".


def corridor_state(domain, where, reward, done):
    observation = jnp.concatenate([jax.nn.one_hot(where, CELLS), (domain[:1] == 0).astype(jnp.float32)])
    return ToyState(observation, reward, done, where)


def corridor_reset(key, domain):
    anywhere = jax.random.randint(key, (), 1, CELLS - 1)
    where = jnp.where(domain[1] == RANDOM, anywhere, domain[1])
    return corridor_state(domain, where, jnp.float32(0), jnp.bool_(False))


def corridor_step(domain, state, command):
    move = (command[0] > 2 / 3).astype(jnp.int32) - (command[0] < 1 / 3).astype(jnp.int32)
    where = jnp.where(state.done, state.where, jnp.clip(state.where + move, 0, CELLS - 1))
    arrives = (where == domain[0]) & ~state.done
    return corridor_state(domain, where, jnp.where(arrives, REWARD, 0.0), state.done | arrives)


def corridor(*domains, max_steps=60, rollouts_per_domain=1):
    domains = jnp.array(domains, jnp.int32)
    return toy_task(
        "corridor", CELLS + 1, max_steps, REWARD, corridor_reset, corridor_step, domains, rollouts_per_domain
    )


def corridor_optimal_values(slopes, intercepts, durations, gamma, goal):
    """Return Q* (CELLS, A) by value iteration over the semi-Markov process; the row of the goal is 0."""
    values = np.zeros((CELLS, len(durations)))
    for _ in range(200):
        new = np.zeros_like(values)
        for start in (cell for cell in range(CELLS) if cell != goal):
            for action, duration in enumerate(durations):
                cell, earned = start, 0.0
                for t in range(duration):
                    command = np.clip(slopes[action] * t + intercepts[action], 0, 1)
                    cell = int(np.clip(cell + (command > 2 / 3) - (command < 1 / 3), 0, CELLS - 1))
                    if cell == goal:
                        earned = REWARD * gamma**t
                        break
                new[start, action] = earned if cell == goal else gamma**duration * values[cell].max()
        values = new
    return values


# Salary: every step pays 1, whatever is done, until `max_steps`. The only sensors are the step, one-hot.


def salary(max_steps):
    def observe(where, reward):
        return ToyState(jax.nn.one_hot(where, max_steps), reward, jnp.bool_(False), where)

    return toy_task(
        "salary",
        sensors=max_steps,
        max_steps=max_steps,
        reward=1.0,
        reset=lambda key, domain: observe(jnp.int32(0), jnp.float32(0)),
        step=lambda domain, state, command: observe(state.where + 1, jnp.float32(1)),
        domains=jnp.zeros((1, 1)),
    )


def action_set(slopes=SLOPES, intercepts=INTERCEPTS, durations=DURATIONS, padding=0):
    def pad(values, dtype):
        return jnp.asarray(np.pad(values, (0, padding)), dtype)

    return ActionSet(
        pad(slopes, jnp.float32)[:, None], pad(intercepts, jnp.float32)[:, None], pad(durations, jnp.int32)
    )


def all_sensors(task, lags=1, n_inputs=None):
    return input_set(np.ones((lags, len(task.sensors)), bool), n_inputs)


def problem(task, settings=SETTINGS, padding=0, lags=1, n_inputs=None):
    inputs = all_sensors(task, lags, n_inputs)
    return Problem(task, settings, task.source_domains("A"), action_set(padding=padding), inputs)


def assert_same(left, right, **tolerance):
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        if jnp.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        if tolerance:
            np.testing.assert_allclose(a, b, **tolerance)
        else:
            np.testing.assert_array_equal(a, b)
