"""The learner "one_network": one flax network with an output per action, trained by gradient descent."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import linen

from qboot import keys
from qboot.qlearning.networks import INITIAL_WEIGHT
from qboot.qlearning.updates import Transition, target_of

Weights = dict  # flax's: {"params": {layer: {"kernel", "bias"}}}


class Values(linen.Module):
    """Values (A,) of all actions in a state, inputs (I,): hidden neurons that all actions share."""

    hidden: int
    n_actions: int

    @linen.compact
    def __call__(self, inputs: jax.Array) -> jax.Array:
        """(I,) -> (A,)."""
        dense = partial(linen.Dense, bias_init=_numbered)
        # Columns are drawn one by one, so that padding leaves the weights of the other actions and inputs as they are.
        features = linen.tanh(dense(self.hidden, kernel_init=_numbered, name="hidden")(inputs))
        return dense(self.n_actions, kernel_init=_numbered_columns, name="output")(features)


def init(key: jax.Array, n_actions: int, n_inputs: int, hidden: int) -> Weights:
    """A network that has learned nothing."""
    return dict(Values(hidden, n_actions).init(keys.key(key, "one network"), jnp.zeros(n_inputs)))


def values(networks: Weights, inputs: jax.Array) -> jax.Array:
    """Values (A,) of all actions in a state, inputs (I,)."""
    hidden, n_actions = networks["params"]["output"]["kernel"].shape
    found: Any = Values(hidden, n_actions).apply(networks, inputs)
    return found


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


def _numbered(key: jax.Array, shape: tuple[int, ...], dtype: type = jnp.float32) -> jax.Array:
    """Weights of any shape, each row drawn by its number."""
    draw = partial(jax.random.uniform, shape=shape[1:], dtype=dtype, minval=-INITIAL_WEIGHT, maxval=INITIAL_WEIGHT)
    return jax.vmap(lambda i: draw(jax.random.fold_in(key, i)))(jnp.arange(shape[0]))


def _numbered_columns(key: jax.Array, shape: tuple[int, int], dtype: type = jnp.float32) -> jax.Array:
    """A matrix of weights, each column drawn by its number."""
    return _numbered(key, shape[::-1], dtype).T
