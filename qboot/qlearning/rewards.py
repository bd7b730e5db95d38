"""Discounted rewards, and the targets of Q-learning that they give (equations 1 to 3, section III-A)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax


class DiscountedReward(NamedTuple):
    """The discounted reward of a stretch of d primitive steps that begins at time t.

    Of a whole rollout, its value is the sum whose expectation the optimal policy maximises (equation 1).
    """

    value: jax.Array  # () sum_i gamma^(i - 1) r(t + i), i = 1 .. d
    discount: jax.Array  # () gamma^d


def no_reward() -> DiscountedReward:
    """The discounted reward of no step at all."""
    return DiscountedReward(jnp.float32(0), jnp.float32(1))


def join(first: DiscountedReward, later: DiscountedReward) -> DiscountedReward:
    """The discounted reward of two stretches, one after the other; one step's is (reward, gamma)."""
    return DiscountedReward(first.value + first.discount * later.value, first.discount * later.discount)


def td_target(reward: DiscountedReward, next_q_max: jax.Array, terminal: jax.Array) -> jax.Array:
    """Right-hand side () of equation 3; for an action of one step, that is equation 2.

    Args:
        reward: discounted reward of the action's d steps.
        next_q_max: () max_a' Q(s(t + d), a').
        terminal: () bool, the rollout ended during the action: nothing is left to expect, whatever `next_q_max` is.
    """
    return reward.value + jnp.where(terminal, 0.0, reward.discount * next_q_max)


def smdp_target(rewards: jax.Array, gamma: float, next_q_max: jax.Array, terminal: jax.Array) -> jax.Array:
    """Value () that equation 3 gives to an action, from the rewards of its steps.

    Args:
        rewards: (d,) one per primitive step.
        gamma: discount per primitive step, in [0, 1].
        next_q_max: () max_a' Q(s(t + d), a').
        terminal: () bool, the rollout ended during the action, and `next_q_max` does not count.
    """

    def step(total: DiscountedReward, reward: jax.Array) -> tuple[DiscountedReward, None]:
        return join(total, DiscountedReward(reward, jnp.float32(gamma))), None

    total, _ = lax.scan(step, no_reward(), jnp.asarray(rewards, jnp.float32))
    return td_target(total, next_q_max, terminal)
