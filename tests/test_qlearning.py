"""The Q-learner as a whole: ends of rollouts, replay, batching. What all learners have in common: test_learners.py."""

import os
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy_tasks import (
    CELLS,
    DURATIONS,
    RANDOM,
    SETTINGS,
    action_set,
    assert_same,
    corridor,
    problem,
    salary,
)

from qboot.qlearning import (
    evaluate,
    init,
    learn,
    q_values,
    rollout,
    trajectory_capacity,
)
from qboot.qlearning.acting import epsilon


def test_the_end_of_a_rollout_is_not_bootstrapped():
    """The steps left are all that can be earned: Q depends on the step alone, cut short by the end."""
    task = salary(max_steps=8)
    problem_ = replace(problem(task, replace(SETTINGS, alpha=0.2)), actions=action_set([0], [0], [3]))
    state, info = learn(init(jax.random.key(0), problem_), problem_, 800)
    values = jax.vmap(q_values, (None, 0))(state.networks, jnp.eye(8)[jnp.array([0, 3, 6])])[:, 0]
    left = [sum(0.9**i for i in range(n)) for n in (8, 5, 2)]
    np.testing.assert_allclose(values, left, rtol=0.02)
    assert int(info.decisions[0, 0]) == 3
    np.testing.assert_allclose(info.discounted_return[0], left[0], rtol=1e-5)


def test_twelve_lags_work():
    task = corridor((CELLS - 1, 0))
    problem_ = problem(task, replace(SETTINGS, lags=12), lags=12)
    state, info = learn(init(jax.random.key(0), problem_), problem_, 2)
    assert state.networks.hidden_weights.shape == (4, 16, 84)
    assert bool(jnp.isfinite(info.largest_q).all())


def test_without_eta_nothing_is_replayed():
    problem_ = problem(corridor((CELLS - 1, 0)), replace(SETTINGS, eta=0))
    state, _ = learn(init(jax.random.key(0), problem_), problem_, 2)
    assert state.store.discounted_return.shape == (1, 0)


def test_no_domain_is_forgotten():
    """The far goal's returns are always smaller than the near goal's, and still have their places."""
    task = corridor((CELLS - 1, CELLS - 2), (0, CELLS - 2), rollouts_per_domain=2)
    problem_ = problem(task)
    state, info = learn(init(jax.random.key(1), problem_), problem_, 400)
    near, far = np.asarray(state.store.discounted_return)
    assert near.min() > far.max() >= far.min() > 0
    key = jax.random.key(7)
    np.testing.assert_array_equal(evaluate(state.networks, key, problem_), [2, 2])
    np.testing.assert_array_equal(info.score[-50:].max(axis=0), [2, 2])


def test_batched_learners_learn_what_single_ones_do():
    """Over seeds, and over action sets of different durations, so that the learners fall out of step."""
    first = problem(corridor((CELLS - 1, RANDOM), (0, RANDOM)))
    sets = [action_set(), action_set(durations=[2, 1, 5, 3]), action_set([0, 0], [1, 0], [4, 3], padding=2)]
    problems = [replace(first, actions=actions) for actions in sets]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)
    capacity = trajectory_capacity(stacked)
    keys = jax.random.split(jax.random.key(0), 3)

    def run(key, problem_):
        return learn(init(key, problem_, capacity), problem_, 20)

    batched_state, batched_info = jax.vmap(run)(keys, stacked)
    for i, key in enumerate(keys):
        state, info = run(key, problems[i])
        assert_same(info, jax.tree.map(lambda leaf, i=i: leaf[i], batched_info), rtol=1e-4, atol=1e-6)
        networks = jax.tree.map(lambda leaf, i=i: leaf[i], batched_state.networks)
        assert_same(state.networks, networks, rtol=1e-3, atol=1e-5)
        np.testing.assert_array_equal(state.store.length, batched_state.store.length[i])


def test_divergence_is_reported():
    problem_ = problem(corridor((CELLS - 1, 0)), replace(SETTINGS, alpha=1e6))
    _, info = learn(init(jax.random.key(0), problem_), problem_, 30)
    assert not np.isfinite(info.td_error[-1])
    assert not np.isfinite(info.largest_q[-1])


def test_learning_goes_on_from_given_networks():
    source, target = problem(corridor((CELLS - 1, RANDOM))), problem(corridor((0, RANDOM), (3, 0)))
    state, _ = learn(init(jax.random.key(0), source), source, 20)
    adapting = init(jax.random.key(1), target, networks=state.networks)
    assert_same(adapting.networks, state.networks)
    assert int(adapting.episode) == 0
    assert adapting.store.discounted_return.shape == (2, 3)
    assert not adapting.store.discounted_return.any()


def test_exploration_goes_on_from_where_it_was():
    """A learner that has done a thousand episodes elsewhere explores like one in its thousandth."""
    target = problem(corridor((CELLS - 1, 2)))
    settings = target.settings
    new, experienced = (init(jax.random.key(1), target, episode=n) for n in (0, 1_000))
    assert float(epsilon(new.episode, settings)) > 0.14
    assert float(epsilon(experienced.episode, settings)) == pytest.approx(settings.epsilon_end, abs=1e-4)
    state, _ = learn(experienced, target, 2)
    assert int(state.episode) == 1_002
    assert_same(new.networks, experienced.networks)


@pytest.mark.parametrize("history", ["steps", "decisions"])
def test_a_recorded_rollout_is_the_evaluated_one(history):
    task = corridor((CELLS - 1, 0), (0, 4))
    problem_ = problem(task, replace(SETTINGS, history=history), lags=2)
    # Large weights make a policy that mixes all actions without any learning.
    networks = jax.tree.map(lambda leaf: 100 * leaf, init(jax.random.key(4), problem_).networks)
    key = jax.random.key(9)
    scores = evaluate(networks, key, problem_)
    for index in range(2):
        played = rollout(networks, jax.random.fold_in(key, index), problem_, problem_.domain(index))
        steps = int(played.mask.sum())
        assert played.mask[:steps].all()
        assert bool(played.final.done) == (scores[index] == 1)
        reward = played.states.reward[:steps].sum() + played.final.reward
        assert float(reward) == float(scores[index]) * task.reward
        in_force = np.asarray(played.actions)[:steps]
        starts = []
        while sum(DURATIONS[starts]) < steps:
            starts.append(in_force[sum(DURATIONS[starts])])
        np.testing.assert_array_equal(in_force, np.repeat(starts, DURATIONS[starts])[:steps])
        assert int(played.states.where[0]) == int(problem_.domains[index, 1])


@pytest.mark.skipif(
    "xla_cpu_small_while_loop_byte_threshold" not in os.environ.get("XLA_FLAGS", "") or jax.default_backend() != "cpu",
    reason="needs XLA's option for small loops, on a CPU",
)
def test_the_loops_of_acting_and_replay_are_compiled_whole():
    problem_ = problem(corridor((CELLS - 1, 0)))
    state = init(jax.random.key(0), problem_)
    compiled = learn.lower(state, problem_, 1).compile().as_text()
    # With one rollout and one episode these are all the loops there are; each is called as one kernel.
    assert compiled.count(" while(") == compiled.count("xla_cpu_small_call") > 0
