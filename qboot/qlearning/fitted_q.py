"""The learner "fitted_q": Neural Fitted Q iteration (Riedmiller, 2005) on the kept trajectories, after every episode.

It learns from the eta best trajectories of each domain and from nothing else, so it needs a larger eta than q_learning.
"""

import jax
import jax.numpy as jnp
import optax
from jax import lax

from qboot.qlearning.networks import QNetworks, q_values
from qboot.qlearning.replay import Trajectory
from qboot.qlearning.rewards import td_target
from qboot.qlearning.updates import Transition, target_of

# Steps of Rprop on all transitions together, with the same targets.
STEPS = 40


def update(
    networks: QNetworks, transition: Transition, action_mask: jax.Array, alpha: float, active: jax.Array
) -> tuple[QNetworks, jax.Array, jax.Array]:
    """Nothing is learned while acting: the networks as they are, their values (A,) and the error ()."""
    del alpha, active
    next_values = q_values(networks, transition.next_inputs)
    target = target_of(transition, next_values, action_mask)
    return networks, next_values, target - q_values(networks, transition.inputs)[transition.action]


def fit(
    networks: QNetworks, key: jax.Array, store: Trajectory, action_mask: jax.Array, alpha: float
) -> tuple[QNetworks, jax.Array, jax.Array]:
    """Fit all transitions that are kept to targets by the present networks; `alpha` is the first step of Rprop.

    Returns:
        The networks, the sum () of |target - Q| before it, and the number () int32 of transitions.
    """
    del key  # nothing is random
    kept = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), store)
    counts = jnp.arange(kept.actions.shape[-1]) < kept.length[:, None]  # (n, K)
    terminal = jnp.arange(kept.actions.shape[-1]) == kept.length[:, None] - 1
    n_transitions = jnp.sum(counts)

    def all_values(networks: QNetworks, inputs: jax.Array) -> jax.Array:
        return jax.vmap(jax.vmap(lambda one: q_values(networks, one)))(inputs)

    next_values = all_values(networks, kept.inputs[:, 1:])
    next_q_max = jnp.max(jnp.where(action_mask, next_values, -jnp.inf), axis=-1)
    targets = td_target(kept.rewards, next_q_max, terminal)

    def errors(networks: QNetworks) -> jax.Array:
        found = jnp.take_along_axis(all_values(networks, kept.inputs[:, :-1]), kept.actions[..., None], axis=-1)
        return jnp.where(counts, targets - found[..., 0], 0.0)

    descent = optax.rprop(alpha)

    def step(carry: tuple, _: None) -> tuple:
        networks, state = carry
        gradient = jax.grad(lambda networks: jnp.mean(jnp.square(errors(networks))))(networks)
        updates, state = descent.update(gradient, state)
        return (optax.apply_updates(networks, updates), state), None

    error_sum = jnp.sum(jnp.abs(errors(networks)))
    (fitted, _), _ = lax.scan(step, (networks, descent.init(networks)), length=STEPS)
    return fitted, error_sum, n_transitions
