"""One update of the Q-function from one executed action (equation 3)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from qboot.qlearning.networks import QNetworks, network_of, q_value, q_values, train
from qboot.qlearning.rewards import DiscountedReward, td_target


class Transition(NamedTuple):
    """One executed action."""

    inputs: jax.Array  # (I,) state before it
    action: jax.Array  # () int32
    reward: DiscountedReward  # of its steps
    next_inputs: jax.Array  # (I,) state after it
    terminal: jax.Array  # () bool: the rollout ended during it


def target_of(transition: Transition, next_values: jax.Array, action_mask: jax.Array) -> jax.Array:
    """Target () of a transition (equation 3), from the values (A,) of the state after it."""
    next_q_max = jnp.max(jnp.where(action_mask, next_values, -jnp.inf))
    return td_target(transition.reward, next_q_max, transition.terminal)


def td_update(
    networks: QNetworks, transition: Transition, action_mask: jax.Array, alpha: float, active: jax.Array
) -> tuple[QNetworks, jax.Array, jax.Array]:
    """Move Q(s, a) towards its target by one step of gradient descent.

    Args:
        networks: of A actions.
        transition: the executed action.
        action_mask: (A,) bool, the actions that the maximum of the target is taken over.
        alpha: learning rate, > 0.
        active: () bool; where it is false, the networks stay as they are.

    Returns:
        The networks, their values (A,) of the state after the transition, and the error () target - Q(s, a)
        before the update.
    """
    next_values = q_values(networks, transition.next_inputs)
    target = target_of(transition, next_values, action_mask)
    networks, error = train(networks, transition.action, transition.inputs, target, alpha, active)
    # One network has changed, so one value is computed again.
    changed = q_value(network_of(networks, transition.action), transition.next_inputs)
    values = jnp.where(jnp.arange(next_values.size) == transition.action, changed, next_values)
    return networks, values, error
