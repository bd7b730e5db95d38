"""The flax network of the learner "one_network": an output per action on hidden neurons that all actions share."""

from functools import partial

import jax
import jax.numpy as jnp
from flax import linen

from qboot.qlearning.networks import INITIAL_WEIGHT


class SharedNetwork(linen.Module):
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


def _numbered(key: jax.Array, shape: tuple[int, ...], dtype: type = jnp.float32) -> jax.Array:
    """Weights of any shape, each row drawn by its number."""
    draw = partial(jax.random.uniform, shape=shape[1:], dtype=dtype, minval=-INITIAL_WEIGHT, maxval=INITIAL_WEIGHT)
    return jax.vmap(lambda i: draw(jax.random.fold_in(key, i)))(jnp.arange(shape[0]))


def _numbered_columns(key: jax.Array, shape: tuple[int, int], dtype: type = jnp.float32) -> jax.Array:
    """A matrix of weights, each column drawn by its number."""
    return _numbered(key, shape[::-1], dtype).T
