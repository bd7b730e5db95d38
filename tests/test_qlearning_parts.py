"""The parts of the Q-learner: equation 3, networks, inputs, exploration, replay, and what is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy_tasks import CELLS, REWARD, SETTINGS, action_set, all_sensors, assert_same, corridor, problem, salary

from qboot.qlearning import (
    LEARNERS,
    check_problem,
    epsilon,
    evaluate,
    init,
    init_networks,
    input_set,
    learn,
    q_value,
    q_values,
    replay,
    smdp_target,
)
from qboot.qlearning.acting import choose
from qboot.qlearning.inputs import read_inputs
from qboot.qlearning.networks import network_of, train
from qboot.qlearning.replay import empty_store, empty_trajectory, keep_best, replay_order, replayed_transition
from qboot.qlearning.rewards import DiscountedReward, td_target
from qboot.qlearning.smdp import execute, start_rollout
from qboot.qlearning.updates import Transition


def start(task, history="steps"):
    problem_ = problem(task, replace(SETTINGS, history=history))
    return problem_, start_rollout(jax.random.key(0), problem_, problem_.domain(0))


def stored(*lengths):
    """Return a store of one domain whose trajectory r holds the inputs r * 100 + k at its k-th decision."""
    store = empty_store(1, len(lengths), capacity=5, n_inputs=1)
    inputs = 100.0 * jnp.arange(float(len(lengths)))[None, :, None, None] + jnp.arange(6.0)[:, None]
    return store._replace(inputs=inputs, length=jnp.array([lengths], jnp.int32))


@pytest.mark.parametrize(
    ("rewards", "terminal", "expected"),
    [
        ([1, 2, 3], False, 1 + 2 / 2 + 3 / 4 + 8 / 8),
        ([1, 2, 3], True, 1 + 2 / 2 + 3 / 4),
        ([0, 0, 0, 0], False, 8 / 16),
        ([5], False, 5 + 8 / 2),
    ],
)
def test_target_is_equation_3(rewards, terminal, expected):
    assert float(smdp_target(jnp.array(rewards), 0.5, 8.0, terminal)) == expected


def test_terminal_target_ignores_a_value_that_is_not_finite():
    assert float(smdp_target(jnp.ones(2), 0.5, jnp.inf, True)) == 1.5


def test_an_action_earns_what_equation_3_says():
    task = salary(max_steps=10)
    problem_, smdp = start(task)
    after, discounted, reward = execute(problem_, jnp.zeros(1), jnp.int32(1), smdp)
    assert (int(after.step), float(reward)) == (3, 3)
    np.testing.assert_allclose(discounted, (1 + 0.9 + 0.81, 0.729), rtol=1e-6)
    assert td_target(discounted, 7.0, True) == smdp_target(jnp.ones(3), SETTINGS.gamma, 7.0, True)
    assert td_target(discounted, 7.0, False) == smdp_target(jnp.ones(3), SETTINGS.gamma, 7.0, False)


def test_an_action_stops_where_the_rollout_ends():
    task = corridor((CELLS - 1, CELLS - 2))
    problem_, smdp = start(task)
    after, discounted, reward = execute(problem_, problem_.domain(0), jnp.int32(1), smdp)
    assert (int(after.step), float(discounted.value), float(reward)) == (1, REWARD, REWARD)


def test_initial_weights_do_not_depend_on_padding():
    key = jax.random.key(3)
    small, large = init_networks(key, 4, 5, 8), init_networks(key, 9, 11, 8)
    assert_same(
        small,
        jax.tree.map(lambda a, b: b[: a.shape[0]], small, large)._replace(
            hidden_weights=large.hidden_weights[:4, :, :5]
        ),
    )
    assert float(jnp.abs(large.hidden_weights).max()) <= 0.1
    assert len(np.unique(large.hidden_weights)) == large.hidden_weights.size


def test_training_is_gradient_descent_on_one_network():
    networks = init_networks(jax.random.key(0), 3, 2, 4)
    x, target, alpha = jnp.array([0.3, 0.8]), jnp.float32(2), 0.5
    w, b, v, c = (np.asarray(leaf, np.float64) for leaf in network_of(networks, 1))
    hidden = np.tanh(0.5 * (w @ x + b))
    error = 2 - 0.5 * (v @ hidden + c)
    back = alpha * error * 0.5 * v * 0.5 * (1 - hidden**2)
    expected = w + np.outer(back, x), b + back, v + alpha * error * 0.5 * hidden, c + alpha * error * 0.5
    trained, returned = train(networks, jnp.int32(1), x, target, alpha, True)
    np.testing.assert_allclose(returned, error, rtol=1e-5)
    assert_same(network_of(trained, 1), jax.tree.map(jnp.asarray, expected), rtol=1e-5, atol=1e-7)
    for other in (0, 2):
        assert_same(network_of(trained, other), network_of(networks, other))
    assert_same(train(networks, jnp.int32(1), x, target, alpha, False)[0], networks)


def test_inputs_are_read_from_the_history():
    inputs = input_set(np.array([[True, False, True], [False, True, False]]), n_inputs=5)
    history = jnp.array([[0.0, 0.25, 0.5], [0.75, 1.0, 0.5]])
    np.testing.assert_array_equal(read_inputs(inputs, history, SETTINGS), [0, 0.5, 1, 0, 0])
    stretched = replace(SETTINGS, input_range=(-3.0, 1.0))
    np.testing.assert_array_equal(read_inputs(inputs, history, stretched), [-3, -1, 1, 0, 0])


@pytest.mark.parametrize(("history", "before"), [("steps", 2), ("decisions", 0)])
def test_a_lag_counts_steps_or_decisions(history, before):
    task = salary(max_steps=10)
    problem_, smdp = start(task, history=history)
    smdp, _, _ = execute(problem_, jnp.zeros(1), jnp.int32(1), smdp)
    np.testing.assert_array_equal(jnp.argmax(smdp.history, axis=1), [3, before])


def test_epsilon_follows_the_paper():
    np.testing.assert_allclose(epsilon(0, SETTINGS), 0.14 * 0.99 + 0.01)
    np.testing.assert_allclose(epsilon(jnp.int32(99), SETTINGS), 0.14 * 0.99**100 + 0.01, rtol=1e-5)


def test_choice_is_uniform_over_the_masked_actions_or_greedy():
    action_mask = jnp.array([True, False, True, True, False])
    values = jnp.array([1.0, 9, 3, 2, 9])
    keys = jax.random.split(jax.random.key(0), 3000)
    choose_each = jax.jit(jax.vmap(choose, (0, None, None, None)))
    explored = choose_each(keys, values, action_mask, 1.0)
    np.testing.assert_allclose(np.bincount(explored, minlength=5) / 3000, np.asarray(action_mask) / 3, atol=0.03)
    greedy = choose_each(keys, values, action_mask, 0.0)
    assert set(np.asarray(greedy)) == {2}


def test_replay_goes_through_each_trajectory_backwards():
    store = stored(3, 0, 5)
    short, long = [2, 1, 0], [204, 203, 202, 201, 200]
    first = set()
    for seed in range(8):
        order, finished = replay_order(jax.random.key(seed), store)
        transitions = [replayed_transition(store, order, finished, i) for i in range(8)]
        seen = [int(t.inputs[0]) for t in transitions]
        assert seen in (short + long, long + short)
        assert [int(t.next_inputs[0]) for t in transitions] == [i + 1 for i in seen]
        assert [bool(t.terminal) for t in transitions] == [i in (2, 204) for i in seen]
        first.add(seen[0])
    assert first == {2, 204}


def test_the_best_trajectories_are_kept():
    store = empty_store(2, 2, capacity=3, n_inputs=1)
    for length, value in enumerate((0.0, 5.0, 2.0, 5.0, 5.0, 1.0)):
        trajectory = empty_trajectory(3, 1)._replace(discounted_return=jnp.float32(value), length=jnp.int32(length))
        store = keep_best(store, jnp.int32(1), trajectory)
    np.testing.assert_array_equal(store.discounted_return, [[0, 0], [5, 5]])
    # Of three trajectories with return 5, the two older ones.
    assert sorted(store.length[1].tolist()) == [1, 3]


def test_what_to_avoid_is_kept_too_and_nothing_never():
    store = empty_store(1, 3, capacity=4, n_inputs=1)
    for length, value in enumerate((-3.0, 0.0, -1.0, -2.0), start=1):
        trajectory = empty_trajectory(4, 1)._replace(discounted_return=jnp.float32(value), length=jnp.int32(length))
        store = keep_best(store, jnp.int32(0), trajectory)
    assert sorted(store.length[0].tolist()) == [1, 3, 4]
    better = empty_trajectory(4, 1)._replace(discounted_return=jnp.float32(7), length=jnp.int32(2))
    assert sorted(keep_best(store, jnp.int32(0), better).discounted_return[0].tolist()) == [-2, -1, 7]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gamma", 1.1),
        ("gamma", np.nan),
        ("epsilon_end", np.nan),
        ("alpha", 0),
        ("alpha", np.nan),
        ("alpha", np.inf),
        ("hidden", 0),
        ("hidden", np.nan),
        ("eta", -1),
        ("eta", 1.5),
        ("lags", 0),
        ("history", "seconds"),
        ("input_range", (1.0, 0.0)),
        ("input_range", (0.0, np.inf)),
        ("input_range", (np.nan, 1.0)),
    ],
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        replace(SETTINGS, **{name: value})


def test_an_unknown_learner_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"must be one of q_learning.*, got 'sarsa'"):
        replace(SETTINGS, algorithm="sarsa")


@pytest.mark.parametrize("name", LEARNERS)
def test_every_learner_is_what_the_table_documents(name):
    """Padding does not show, an inactive update changes nothing, and repeated updates come to their target."""
    learner, mask = LEARNERS[name], jnp.array([True, False, True])
    networks, inputs = learner.init(jax.random.key(0), 3, 2, 8), jnp.array([1.0, 0.5])
    padded = learner.init(jax.random.key(0), 5, 4, 8)
    np.testing.assert_allclose(learner.values(padded, jnp.pad(inputs, (0, 2)))[:3], learner.values(networks, inputs))
    transition = Transition(inputs, jnp.int32(2), DiscountedReward(jnp.float32(3), 0.5), jnp.zeros(2), jnp.bool_(True))
    same, _, error = learner.update(networks, transition, mask, 0.2, jnp.bool_(False))
    assert_same(same, networks)
    np.testing.assert_allclose(error, 3 - learner.values(networks, inputs)[2], rtol=1e-5)
    store = replay.write(empty_trajectory(1, 2), jnp.int32(0), transition)
    store = store._replace(inputs=store.inputs.at[0].set(inputs), length=jnp.int32(1))
    store = jax.tree.map(lambda leaf: leaf[None, None], store)

    def learn_once(networks, key):
        networks, values, _ = learner.update(networks, transition, mask, 0.2, jnp.bool_(True))
        expected = learner.values(networks, transition.next_inputs)
        networks, error_sum, n = learner.replay(networks, key, store, mask, 0.2)
        return networks, (values, expected, error_sum / n.astype(jnp.float32))

    networks, (values, expected, errors) = jax.lax.scan(learn_once, networks, jax.random.split(jax.random.key(1), 200))
    np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-6)
    assert errors[-1] < 0.01 < errors[0]
    np.testing.assert_allclose(learner.values(networks, inputs)[2], 3, atol=0.01)


def test_what_does_not_fit_is_refused():
    problem_, key = problem(corridor((CELLS - 1, 0))), jax.random.key(0)
    check_problem(problem_)
    two_effectors = problem_.actions._replace(slopes=jnp.zeros((4, 2)), intercepts=jnp.zeros((4, 2)))
    refused = {
        "effectors": replace(problem_, actions=two_effectors),
        "lags": replace(problem_, inputs=all_sensors(problem_.task, lags=3)),
        "sensors": replace(problem_, inputs=input_set(np.ones((1, 9)))),
        "duration": replace(problem_, actions=action_set([0], [0], [0])),
    }
    for word, odd in refused.items():
        with pytest.raises(ValueError, match=word):
            check_problem(odd)
    with pytest.raises(ValueError, match="networks"):
        init(key, problem_, networks=init_networks(key, 4, 2, 16))
    short = replace(problem_, actions=problem_.actions._replace(durations=jnp.ones(3, jnp.int32)))
    state, longer = init(key, problem_), all_sensors(problem_.task, lags=2)
    with pytest.raises(AssertionError, match="shape"):
        init(key, short)
    with pytest.raises(AssertionError, match="shape"):
        learn(state, short, 1)
    with pytest.raises(AssertionError, match="shape"):
        evaluate(state.networks, key, short)
    for odd in (state._replace(episode=jnp.zeros(2, jnp.int32)), init(key, replace(problem_, inputs=longer))):
        with pytest.raises(AssertionError):
            learn(odd, problem_, 1)
    with pytest.raises(AssertionError, match="rank"):
        init(jax.random.split(key), problem_)
    with pytest.raises(AssertionError, match="rank"):
        evaluate(state.networks, jax.random.split(key), problem_)
    with pytest.raises(ValueError, match="inputs"):
        input_set(np.ones((2, 3)), n_inputs=5)
    with pytest.raises(ValueError, match="shape"):
        input_set(np.ones(3))


def test_one_value_is_one_of_all_values():
    networks = init_networks(jax.random.key(0), 3, 4, 5)
    x = jnp.arange(4.0)
    one = q_value(network_of(networks, 2), x)
    np.testing.assert_allclose(one, q_values(networks, x)[2], rtol=1e-6)
