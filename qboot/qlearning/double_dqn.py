"""The learner "double_dqn": the target's action by the networks, its value by a copy (van Hasselt et al., 2016)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from qboot.qlearning.networks import QNetworks, init_networks, q_values, train
from qboot.qlearning.rewards import td_target
from qboot.qlearning.updates import Transition

# Updates after which the networks are copied.
COPY_PERIOD = 200


class DoubleNetworks(NamedTuple):
    """Networks, and the copy that tells what the actions they choose are worth."""

    networks: QNetworks
    copy: QNetworks
    n_updates: jax.Array  # () int32


def init(key: jax.Array, n_actions: int, n_inputs: int, hidden: int) -> DoubleNetworks:
    """Networks that have learned nothing, as those of q_learning, and their copy."""
    networks = init_networks(key, n_actions, n_inputs, hidden)
    return DoubleNetworks(networks, networks, jnp.int32(0))


def values(networks: DoubleNetworks, inputs: jax.Array) -> jax.Array:
    """Values (A,) of all actions in a state, inputs (I,)."""
    return q_values(networks.networks, inputs)


def update(
    networks: DoubleNetworks, transition: Transition, action_mask: jax.Array, alpha: float, active: jax.Array
) -> tuple[DoubleNetworks, jax.Array, jax.Array]:
    """`updates.td_update` with the target's action and its value told by different networks."""
    best = jnp.argmax(jnp.where(action_mask, values(networks, transition.next_inputs), -jnp.inf))
    next_value = q_values(networks.copy, transition.next_inputs)[best]
    target = td_target(transition.reward, next_value, transition.terminal)
    trained, error = train(networks.networks, transition.action, transition.inputs, target, alpha, active)
    n_updates = networks.n_updates + active.astype(jnp.int32)
    is_due = active & (n_updates % COPY_PERIOD == 0)
    copy = jax.tree.map(lambda new, old: jnp.where(is_due, new, old), trained, networks.copy)
    networks = DoubleNetworks(trained, copy, n_updates)
    return networks, values(networks, transition.next_inputs), error
