"""One update of the Q-function from one executed action (equation 3)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from qboot.qlearning.networks import QNetworks, q_values, train
from qboot.qlearning.smdp import Earned, bootstrapped


class Transition(NamedTuple):
    """One executed action."""

    inputs: jax.Array  # (I,) state before it
    action: jax.Array  # () int32
    earned: Earned  # of its steps
    next_inputs: jax.Array  # (I,) state after it
    terminal: jax.Array  # () bool: the test ended during it


@jax.custom_batching.custom_vmap
def anywhere(flag: jax.Array) -> jax.Array:
    """Return `flag`, () bool; under `vmap`, whether it is true in any batched instance.

    A `while_loop` whose condition differs between instances copies its whole carry, all the networks
    included, at every iteration. With this condition it does not, and its body masks what must not change.
    """
    return flag


@anywhere.def_vmap
def _(axis_size: int, in_batched: list[bool], flag: jax.Array) -> tuple[jax.Array, bool]:
    return jnp.any(flag), False


def learn_from(
    networks: QNetworks, transition: Transition, usable: jax.Array, alpha: float, active: jax.Array
) -> tuple[QNetworks, jax.Array, jax.Array]:
    """Move Q(s, a) towards the right-hand side of equation 3 where `active`, () bool, is true.

    Returns the networks, Q(s', .) (A,) before the update, and the error ().
    """
    next_values = q_values(networks, transition.next_inputs)
    next_q_max = jnp.max(jnp.where(usable, next_values, -jnp.inf))
    target = bootstrapped(transition.earned, next_q_max, transition.terminal)
    networks, error = train(networks, transition.action, transition.inputs, target, alpha, active)
    return networks, next_values, error
