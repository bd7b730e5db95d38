"""Acting in one rollout, epsilon-greedily, with an update after every action (section IV-E)."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot import keys
from qboot.envs.task import Domain
from qboot.qlearning import replay
from qboot.qlearning.batching import any_in_batch
from qboot.qlearning.inputs import read_inputs
from qboot.qlearning.problem import Problem
from qboot.qlearning.replay import Trajectory
from qboot.qlearning.rewards import DiscountedReward, join, no_reward
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import SmdpState, execute, is_ongoing, start_rollout
from qboot.qlearning.updates import Transition


class Acting(NamedTuple):
    """A rollout in progress."""

    networks: Any  # the learner's
    smdp: SmdpState
    inputs: jax.Array  # (I,) state
    values: jax.Array  # (A,) Q(s, .)
    trajectory: Trajectory
    decision: jax.Array  # () int32 decisions taken by the longest of all rollouts that run in step
    discounted_reward: DiscountedReward  # since the start
    reward: jax.Array  # () plain sum since the start
    error_sum: jax.Array  # () of |target - Q|
    largest_q: jax.Array  # ()


def epsilon(episode: jax.Array, settings: LearnerSettings) -> jax.Array:
    """Probability () of a random action in an episode, () int32, counted from 0 (section IV-E)."""
    start, end = settings.epsilon_start, settings.epsilon_end
    return (start - end) * lax.pow(jnp.float32(settings.epsilon_stepness), 1 + episode) + end


def choose(key: jax.Array, values: jax.Array, action_mask: jax.Array, exploration: jax.Array) -> jax.Array:
    """Epsilon-greedy action, () int32 (section III-A).

    Args:
        key: random key.
        values: (A,) Q(s, .).
        action_mask: (A,) bool, the actions to choose from; at least one.
        exploration: () probability of a random action.
    """
    nth = jax.random.randint(keys.key(key, "action"), (), 0, jnp.sum(action_mask))
    explored = jnp.argmax(jnp.cumsum(action_mask) > nth)
    return jnp.where(jax.random.uniform(keys.key(key, "explore")) < exploration, explored, greedy(values, action_mask))


def greedy(values: jax.Array, action_mask: jax.Array) -> jax.Array:
    """Action of greatest value, () int32, among those of the mask (A,), given their values (A,)."""
    return jnp.argmax(jnp.where(action_mask, values, -jnp.inf))


def run_rollout(
    networks: Any, key: jax.Array, problem: Problem, domain: Domain, exploration: jax.Array, capacity: int
) -> Acting:
    """Act in one domain until the rollout ends, learning after every action.

    Args:
        networks: the learner's.
        key: random key of this rollout.
        problem: what is learned.
        domain: one of its domains.
        exploration: () probability of a random action.
        capacity: decisions that the trajectory has room for; acting ends there.
    """
    action_mask = problem.action_mask
    decisions_key = keys.key(key, "decisions")

    def decide(acting: Acting) -> Acting:
        active = is_ongoing(problem.task, acting.smdp)
        action = choose(jax.random.fold_in(decisions_key, acting.decision), acting.values, action_mask, exploration)
        smdp, discounted, reward = execute(problem, domain, action, acting.smdp)
        next_inputs = read_inputs(problem.inputs, smdp.history, problem.settings)
        terminal = ~is_ongoing(problem.task, smdp)
        transition = Transition(acting.inputs, action, discounted, next_inputs, terminal)
        networks, values, error = problem.learner.update(
            acting.networks, transition, action_mask, problem.settings.alpha, active
        )
        trajectory = replay.write(acting.trajectory, acting.decision, transition)
        return Acting(
            networks=networks,
            smdp=smdp,
            inputs=next_inputs,
            values=values,
            trajectory=trajectory._replace(length=trajectory.length + active.astype(jnp.int32)),
            decision=acting.decision + 1,
            discounted_reward=join(acting.discounted_reward, discounted),
            reward=acting.reward + reward,
            error_sum=acting.error_sum + jnp.where(active, jnp.abs(error), 0.0),
            largest_q=jnp.maximum(acting.largest_q, jnp.where(active, largest(acting.values), 0.0)),
        )

    def largest(values: jax.Array) -> jax.Array:
        return jnp.max(jnp.where(action_mask, jnp.abs(values), 0.0))

    def is_running(acting: Acting) -> jax.Array:
        return any_in_batch(is_ongoing(problem.task, acting.smdp)) & (acting.decision < capacity)

    smdp = start_rollout(keys.key(key, "reset"), problem, domain)
    first_inputs = read_inputs(problem.inputs, smdp.history, problem.settings)
    trajectory = replay.empty_trajectory(capacity, first_inputs.size)
    zero = jnp.float32(0)
    acting = Acting(
        networks=networks,
        smdp=smdp,
        inputs=first_inputs,
        values=problem.learner.values(networks, first_inputs),
        trajectory=trajectory._replace(inputs=trajectory.inputs.at[0].set(first_inputs)),
        decision=jnp.int32(0),
        discounted_reward=no_reward(),
        reward=zero,
        error_sum=zero,
        largest_q=zero,
    )
    acting = lax.while_loop(is_running, decide, acting)
    return acting._replace(trajectory=acting.trajectory._replace(discounted_return=acting.discounted_reward.value))
