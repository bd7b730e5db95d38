"""The learner "adam": the paper's networks and targets, trained by Adam (Kingma and Ba, 2015)."""

from typing import Any, NamedTuple

import jax
import optax

from qboot.qlearning.networks import QNetworks, init_networks, network_of, put_network, q_values, td_error
from qboot.qlearning.updates import Transition, target_of


class AdamNetworks(NamedTuple):
    """Networks with the moments of their gradients; leading axis A on every leaf."""

    networks: QNetworks
    moments: Any  # of optax.adam


def init(key: jax.Array, n_actions: int, n_inputs: int, hidden: int) -> AdamNetworks:
    """Networks that have learned nothing, as those of q_learning."""
    networks = init_networks(key, n_actions, n_inputs, hidden)
    # Moments do not depend on the learning rate.
    return AdamNetworks(networks, jax.vmap(optax.adam(1.0).init)(networks))


def values(networks: AdamNetworks, inputs: jax.Array) -> jax.Array:
    """Values (A,) of all actions in a state, inputs (I,)."""
    return q_values(networks.networks, inputs)


def update(
    networks: AdamNetworks, transition: Transition, action_mask: jax.Array, alpha: float, active: jax.Array
) -> tuple[AdamNetworks, jax.Array, jax.Array]:
    """`updates.td_update` with a step of Adam of the executed action's network and moments."""
    action = transition.action
    target = target_of(transition, values(networks, transition.next_inputs), action_mask)
    network, moments = network_of(networks, action)
    gradient, error = jax.grad(td_error, has_aux=True)(network, transition.inputs, target)
    with jax.numpy_dtype_promotion("standard"):  # optax raises floats to whole powers
        updates, moments = optax.adam(alpha).update(gradient, moments)
    networks = put_network(networks, action, AdamNetworks(optax.apply_updates(network, updates), moments), active)
    return networks, values(networks, transition.next_inputs), error
