"""The Q-function: one small multilayer perceptron per action (sections III-A and IV-E).

All networks are stacked on a leading axis A. The weights are laid out (A, H, I), neuron by neuron, because
that is the order in which XLA multiplies a matrix by one vector fastest on a CPU: 4 us for all 17 networks of
125 neurons and 40 inputs, against 18 us and more for the (A, I, H) order of common layer libraries.
"""

from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import optax
from jax import lax

from qboot import keys

STEEPNESS = 0.5  # of every neuron, as in the FANN library that the authors used
INITIAL_WEIGHT = 0.1  # weights and biases start uniform in [-0.1, 0.1]

Networks = TypeVar("Networks")  # a tree of arrays with leading axis A, such as QNetworks


class QNetworks(NamedTuple):
    """The networks of all actions; without the leading axis A, the network of one action."""

    hidden_weights: jax.Array  # (A, H, I)
    hidden_biases: jax.Array  # (A, H)
    output_weights: jax.Array  # (A, H)
    output_biases: jax.Array  # (A,)


@partial(jax.jit, static_argnames=("n_actions", "n_inputs", "hidden"))
def init_networks(key: jax.Array, n_actions: int, n_inputs: int, hidden: int) -> QNetworks:
    """Networks of `n_actions` actions, drawn at random.

    The weights of action a and input i depend on the key, a, i and `hidden` alone. Padding a set of actions
    or of inputs therefore leaves the weights of the others as they are.
    """
    draw = partial(jax.random.uniform, shape=(hidden,), minval=-INITIAL_WEIGHT, maxval=INITIAL_WEIGHT)

    def network(key: jax.Array) -> QNetworks:
        # All at once: each call of a random number generator takes a tenth of a second to compile.
        columns, *others = keys.named(key, ("hidden weights", "hidden biases", "output weights", "output bias"))
        drawn = jax.vmap(draw)(jnp.concatenate([_numbered(columns, n_inputs), jnp.stack(others)]))
        biases, output_weights, output_bias = drawn[n_inputs:]
        return QNetworks(drawn[:n_inputs].T, biases, output_weights, output_bias[0])

    return jax.vmap(network)(_numbered(key, n_actions))


def _numbered(key: jax.Array, n: int) -> jax.Array:
    return jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(n))


def q_value(network: QNetworks, inputs: jax.Array) -> jax.Array:
    """Value () that the network of one action gives to a state, inputs (I,)."""
    hidden = jnp.tanh(STEEPNESS * (network.hidden_weights @ inputs + network.hidden_biases))
    return STEEPNESS * (network.output_weights @ hidden + network.output_biases)


q_values = jax.vmap(q_value, in_axes=(0, None))
"""Values (A,) of all actions in one state: (networks, inputs (I,)) -> (A,)."""


def network_of(networks: Networks, action: jax.Array) -> Networks:
    """What a tree of leading axis A holds of one action, () int32, such as its network."""
    return jax.tree.map(lambda leaf: lax.dynamic_index_in_dim(leaf, action, keepdims=False), networks)


def put_network(networks: Networks, action: jax.Array, network: Networks, active: jax.Array) -> Networks:
    """The tree with `network` in the place of an action, () int32, or as it was where `active`, () bool, is false."""

    def put(leaf: jax.Array, new: jax.Array) -> jax.Array:
        old = lax.dynamic_index_in_dim(leaf, action, keepdims=False)
        return lax.dynamic_update_index_in_dim(leaf, jnp.where(active, new, old), action, 0)

    return jax.tree.map(put, networks, network)


def td_error(network: QNetworks, inputs: jax.Array, target: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(target - Q)^2 / 2 () of one action's network, and target - Q ()."""
    error = target - q_value(network, inputs)
    return jnp.square(error) / 2, error


def train(
    networks: QNetworks,
    action: jax.Array,
    inputs: jax.Array,
    target: jax.Array,
    alpha: float,
    active: jax.Array,
) -> tuple[QNetworks, jax.Array]:
    """Take one step of gradient descent on (target - Q(s, a))^2 / 2 with the network of the executed action.

    Only one network is written back, so that the cost does not grow with the number of actions.

    Args:
        networks: of A actions.
        action: () int32, the executed one.
        inputs: (I,) state that it was executed in.
        target: () what its value should have been.
        alpha: learning rate, > 0.
        active: () bool; where it is false, nothing changes.

    Returns:
        The networks, and the error () target - Q(s, a) before the step.
    """
    network = network_of(networks, action)
    gradient, error = jax.grad(td_error, has_aux=True)(network, inputs, target)
    descent = optax.sgd(alpha)
    updates, _ = descent.update(gradient, descent.init(network))
    return put_network(networks, action, optax.apply_updates(network, updates), active), error
