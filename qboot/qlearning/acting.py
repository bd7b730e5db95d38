"""Acting in one test, epsilon-greedily, with an update after every action (section IV-E)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import ActionSet
from qboot.qlearning import replay
from qboot.qlearning.inputs import InputSet, read_inputs
from qboot.qlearning.networks import QNetworks, network_of, q_value, q_values
from qboot.qlearning.replay import Trajectory
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import (
    Earned,
    Situation,
    earn_more,
    execute,
    is_ongoing,
    nothing_earned,
    start_test,
    usable_actions,
)
from qboot.qlearning.updates import Transition, anywhere, learn_from


class Acting(NamedTuple):
    """A test in progress."""

    networks: QNetworks
    situation: Situation
    inputs: jax.Array  # (I,) state
    values: jax.Array  # (A,) Q(s, .)
    trajectory: Trajectory
    decision: jax.Array  # () int32 decisions taken by the longest of all tests that run in step
    earned: Earned  # since the start
    rewards: jax.Array  # () plain sum since the start
    error_sum: jax.Array  # () of |target - Q|
    largest_q: jax.Array  # ()


def epsilon(episode: jax.Array, settings: LearnerSettings) -> jax.Array:
    """Return the probability () of a random action in an episode, counted from 0 (section IV-E)."""
    start, end = settings.epsilon_start, settings.epsilon_end
    return (start - end) * settings.epsilon_stepness ** (1 + episode) + end


def choose(key: jax.Array, values: jax.Array, usable: jax.Array, exploration: jax.Array) -> jax.Array:
    """Return an epsilon-greedy action, () int32, among the usable ones (A,), given their values (A,)."""
    explore_key, action_key = jax.random.split(key)
    nth = jax.random.randint(action_key, (), 0, jnp.sum(usable))
    explored = jnp.argmax(jnp.cumsum(usable) > nth)
    greedy = jnp.argmax(jnp.where(usable, values, -jnp.inf))
    return jnp.where(jax.random.uniform(explore_key) < exploration, explored, greedy)


def run_test(
    networks: QNetworks,
    key: jax.Array,
    task: Task,
    domain: Domain,
    actions: ActionSet,
    inputs: InputSet,
    settings: LearnerSettings,
    exploration: jax.Array,
    capacity: int,
) -> Acting:
    """Act in one domain until the test ends, learning after every action."""
    usable = usable_actions(actions)
    reset_key, action_key = jax.random.split(key)

    def decide(acting: Acting) -> Acting:
        active = is_ongoing(task, acting.situation)
        action = choose(jax.random.fold_in(action_key, acting.decision), acting.values, usable, exploration)
        situation, earned, rewards = execute(task, domain, actions, action, acting.situation, settings)
        next_inputs = read_inputs(inputs, situation.history, settings)
        terminal = ~is_ongoing(task, situation)
        transition = Transition(acting.inputs, action, earned, next_inputs, terminal)
        networks, values, error = learn_from(acting.networks, transition, usable, settings.alpha, active)
        # The update has changed one network, so one of the values at the next state is computed again.
        changed = q_value(network_of(networks, action), next_inputs)
        trajectory = replay.write(acting.trajectory, acting.decision, transition)
        return Acting(
            networks=networks,
            situation=situation,
            inputs=next_inputs,
            values=jnp.where(jnp.arange(values.size) == action, changed, values),
            trajectory=trajectory._replace(length=trajectory.length + active),
            decision=acting.decision + 1,
            earned=earn_more(acting.earned, earned),
            rewards=acting.rewards + rewards,
            error_sum=acting.error_sum + jnp.where(active, jnp.abs(error), 0.0),
            largest_q=jnp.maximum(acting.largest_q, jnp.where(active, largest(acting.values), 0.0)),
        )

    def largest(values: jax.Array) -> jax.Array:
        return jnp.max(jnp.where(usable, jnp.abs(values), 0.0))

    def is_running(acting: Acting) -> jax.Array:
        return anywhere(is_ongoing(task, acting.situation)) & (acting.decision < capacity)

    situation = start_test(reset_key, task, domain, settings)
    first_inputs = read_inputs(inputs, situation.history, settings)
    trajectory = replay.empty_trajectory(capacity, first_inputs.size)
    zero = jnp.float32(0)
    acting = Acting(
        networks=networks,
        situation=situation,
        inputs=first_inputs,
        values=q_values(networks, first_inputs),
        trajectory=trajectory._replace(inputs=trajectory.inputs.at[0].set(first_inputs)),
        decision=jnp.int32(0),
        earned=nothing_earned(),
        rewards=zero,
        error_sum=zero,
        largest_q=zero,
    )
    acting = lax.while_loop(is_running, decide, acting)
    return acting._replace(trajectory=acting.trajectory._replace(score=acting.earned.value))
