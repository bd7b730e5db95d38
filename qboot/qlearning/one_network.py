"""The learner "one_network": one flax network with an output per action, trained by gradient descent."""

from typing import Any

import jax
import jax.numpy as jnp
import optax

from qboot import keys
from qboot.qlearning.updates import Transition, target_of

Weights = dict  # flax's: {"params": {layer: {"kernel", "bias"}}}


def init(key: jax.Array, n_actions: int, n_inputs: int, hidden: int) -> Weights:
    """A network that has learned nothing."""
    return dict(_network(hidden, n_actions).init(keys.key(key, "one network"), jnp.zeros(n_inputs)))


def values(networks: Weights, inputs: jax.Array) -> jax.Array:
    """Values (A,) of all actions in a state, inputs (I,)."""
    hidden, n_actions = networks["params"]["output"]["kernel"].shape
    return _network(hidden, n_actions).apply(networks, inputs)


def update(
    networks: Weights, transition: Transition, action_mask: jax.Array, alpha: float, active: jax.Array
) -> tuple[Weights, jax.Array, jax.Array]:
    """`updates.td_update` of the one network, by the error of the executed action."""
    target = target_of(transition, values(networks, transition.next_inputs), action_mask)

    def loss(networks: Weights) -> tuple[jax.Array, jax.Array]:
        error = target - values(networks, transition.inputs)[transition.action]
        return jnp.square(error) / 2, error

    gradient, error = jax.grad(loss, has_aux=True)(networks)
    descent = optax.sgd(alpha)
    updates, _ = descent.update(gradient, descent.init(networks))
    trained = optax.apply_updates(networks, updates)
    networks = jax.tree.map(lambda new, old: jnp.where(active, new, old), trained, networks)
    return networks, values(networks, transition.next_inputs), error


def _network(hidden: int, n_actions: int) -> Any:
    # flax takes a tenth of a second to load, and no other learner needs it.
    from qboot.qlearning.shared_network import SharedNetwork

    return SharedNetwork(hidden, n_actions)
