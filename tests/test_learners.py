"""Every learner of the table: the optimal values of a corridor, padding, batching, resuming."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy_tasks import (
    CELLS,
    DURATIONS,
    INTERCEPTS,
    RANDOM,
    REWARD,
    SETTINGS,
    SLOPES,
    assert_same,
    corridor,
    corridor_optimal_values,
    problem,
)

from qboot.qlearning import LEARNERS, init, learn
from qboot.qlearning.replay import empty_store
from qboot.qlearning.rewards import DiscountedReward
from qboot.qlearning.updates import Transition

GOAL = CELLS - 1
# What each needs for the corridor: settings, episodes. Fitted Q learns from what is kept, so it keeps much.
NEEDS = {
    "q_learning": ({}, 2000),
    "adam": ({"alpha": 0.003}, 1500),
    "double_dqn": ({}, 4000),
    "one_network": ({"alpha": 0.05}, 3000),
    "fitted_q": ({"eta": 30, "alpha": 0.01}, 60),
}
# Fitted Q learns by code of its own, the others by what the first one learns by.
OTHERS_SLOW = [
    name if name in ("q_learning", "fitted_q") else pytest.param(name, marks=pytest.mark.slow) for name in LEARNERS
]


@pytest.mark.parametrize("name", LEARNERS)
def test_the_optimal_values_of_a_corridor_are_learned(name):
    changed, n_episodes = NEEDS.get(name, ({}, 3000))
    settings = replace(SETTINGS, algorithm=name, epsilon_start=0.5, epsilon_end=0.5, **changed)
    # From every cell, so that those who learn from the best trajectories of each domain see them all.
    problem_ = problem(corridor(*((GOAL, start) for start in range(GOAL)), max_steps=20), settings)
    state, info = learn(init(jax.random.key(0), problem_), problem_, n_episodes)
    expected = corridor_optimal_values(SLOPES, INTERCEPTS, DURATIONS, settings.gamma, goal=GOAL)[:-1]
    inputs = jnp.pad(jnp.eye(CELLS), ((0, 0), (0, 1)))[:-1]
    values = np.asarray(jax.vmap(LEARNERS[name].values, (None, 0))(state.networks, inputs))
    np.testing.assert_allclose(values, expected, atol=0.06 * REWARD)
    where = np.arange(GOAL)
    np.testing.assert_allclose(expected[where, values.argmax(axis=1)], expected.max(axis=1))
    assert float(info.td_error[-1]) < 0.1 * float(info.td_error[0])


@pytest.mark.parametrize("name", OTHERS_SLOW)
def test_learning_in_two_parts_is_learning_at_once(name):
    problem_ = problem(corridor((GOAL, RANDOM), (0, RANDOM)), replace(SETTINGS, algorithm=name))
    first = init(jax.random.key(5), problem_)
    half, info_1 = learn(first, problem_, 3)
    parts, info_2 = learn(half, problem_, 3)
    whole, info = learn(first, problem_, 6)
    assert_same(parts, whole)
    assert_same(jax.tree.map(lambda a, b: jnp.concatenate([a, b]), info_1, info_2), info)


@pytest.mark.parametrize("name", OTHERS_SLOW)
def test_padding_changes_nothing(name):
    settings = replace(SETTINGS, algorithm=name)
    task = corridor((GOAL, RANDOM), (0, RANDOM))
    small, large = problem(task, settings), problem(task, settings, padding=3, n_inputs=20)
    # As many as in the test above: one program serves both.
    state, info = learn(init(jax.random.key(2), small), small, 6)
    padded, padded_info = learn(init(jax.random.key(2), large), large, 6)
    assert_same(info, padded_info, rtol=1e-4, atol=1e-6)
    inputs = jnp.linspace(0, 1, CELLS + 1)
    values = LEARNERS[name].values(state.networks, inputs)
    of_padded = LEARNERS[name].values(padded.networks, jnp.pad(inputs, (0, 20 - inputs.size)))
    np.testing.assert_allclose(of_padded[: values.size], values, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", LEARNERS)
def test_one_that_waits_does_not_change(name):
    networks = LEARNERS[name].init(jax.random.key(0), 4, 3, 5)
    transition = Transition(
        jnp.ones(3), jnp.int32(1), DiscountedReward(jnp.float32(1), jnp.float32(0.9)), jnp.zeros(3), jnp.bool_(False)
    )
    mask = jnp.ones(4, bool)
    update, replay = jax.jit(LEARNERS[name].update), jax.jit(LEARNERS[name].replay)
    assert_same(update(networks, transition, mask, 0.1, jnp.bool_(False))[0], networks)
    replayed, error_sum, n = replay(networks, jax.random.key(1), empty_store(2, 3, 6, 3), mask, 0.1)
    assert_same(replayed, networks)
    assert (float(error_sum), int(n)) == (0.0, 0)


def test_the_target_of_double_q_learning_is_told_by_the_copy():
    learner = LEARNERS["double_dqn"]
    networks = learner.init(jax.random.key(0), 4, 3, 5)
    # The networks prefer action 2, which the copy values at the output's bias: half of 8.
    trained = networks.networks._replace(output_biases=jnp.array([0.0, 0.0, 9.0, 0.0]))
    biases = jnp.array([100.0, 100.0, 8.0, 100.0])
    copy = networks.copy._replace(output_biases=biases, output_weights=jnp.zeros((4, 5)))
    networks = networks._replace(networks=trained, copy=copy)
    inputs = jnp.zeros(3)
    reward = DiscountedReward(jnp.float32(1), jnp.float32(0.5))
    transition = Transition(inputs, jnp.int32(0), reward, inputs, jnp.bool_(False))
    before = learner.values(networks, inputs)[0]
    _, _, error = learner.update(networks, transition, jnp.ones(4, bool), 0.1, jnp.bool_(True))
    np.testing.assert_allclose(error, 1 + 0.5 * 4 - before, rtol=1e-5)
