"""The replay of the best trajectories (section IV-E).

The paper keeps "the eta best trajectories". An episode visits several domains, and ours is the reading that
the eta best are kept *of each domain*: with one list for all, the domain in which rewards come soonest would
push the others out and the learner would forget them.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.qlearning.batching import any_in_batch
from qboot.qlearning.rewards import DiscountedReward
from qboot.qlearning.updates import Transition


class Trajectory(NamedTuple):
    """One rollout as a list of at most K transitions; a store of trajectories has leading axes (D, eta).

    Transition k leads from `inputs[k]` to `inputs[k + 1]`; the last one ends the rollout. An empty place of a
    store has length 0 and return 0.
    """

    inputs: jax.Array  # (K + 1, I) states at the decisions, and the final one
    actions: jax.Array  # (K,) int32
    rewards: DiscountedReward  # two (K,)
    length: jax.Array  # () int32 transitions
    discounted_return: jax.Array  # () of the whole rollout, in primitive time


def empty_trajectory(capacity: int, n_inputs: int) -> Trajectory:
    """A trajectory without transitions, and with room for `capacity` of them."""
    return Trajectory(
        inputs=jnp.zeros((capacity + 1, n_inputs)),
        actions=jnp.zeros(capacity, jnp.int32),
        rewards=DiscountedReward(jnp.zeros(capacity), jnp.zeros(capacity)),
        length=jnp.int32(0),
        discounted_return=jnp.float32(0),
    )


@partial(jax.jit, static_argnames=("n_domains", "eta", "capacity", "n_inputs"))
def empty_store(n_domains: int, eta: int, capacity: int, n_inputs: int) -> Trajectory:
    """Eta empty places for each domain."""
    trajectory = empty_trajectory(capacity, n_inputs)
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n_domains, eta, *leaf.shape)), trajectory)


def write(trajectory: Trajectory, index: jax.Array, transition: Transition) -> Trajectory:
    """The trajectory with a transition at `index`, () int32; its length and its return are the caller's to set."""

    def put(leaf: jax.Array, value: jax.Array, index: jax.Array) -> jax.Array:
        return lax.dynamic_update_index_in_dim(leaf, value, index, 0)

    return trajectory._replace(
        inputs=put(trajectory.inputs, transition.next_inputs, index + 1),
        actions=put(trajectory.actions, transition.action, index),
        rewards=jax.tree.map(lambda leaf, value: put(leaf, value, index), trajectory.rewards, transition.reward),
    )


def keep_best(store: Trajectory, domain: jax.Array, trajectory: Trajectory) -> Trajectory:
    """Let a new trajectory take the place of the worst of its domain, () int32, if its return is greater.

    Of equal returns the older trajectory stays. A return of 0 is never kept, for nothing was met on the way; one below
    0 is, and teaches what to avoid.
    """
    if store.length.shape[1] == 0:
        return store
    returns = jnp.where(store.length[domain] > 0, store.discounted_return[domain], -jnp.inf)
    place = jnp.argmin(returns)
    is_better = (trajectory.discounted_return > returns[place]) & (trajectory.discounted_return != 0)
    return jax.tree.map(
        lambda kept, new: kept.at[domain, place].set(jnp.where(is_better, new, kept[domain, place])),
        store,
        trajectory,
    )


def replay_order(key: jax.Array, store: Trajectory) -> tuple[jax.Array, jax.Array]:
    """The order in which all kept trajectories are replayed, drawn at random.

    Returns:
        Their indices (D * eta,) int32 in the flattened store, and after how many transitions each one is
        finished, (D * eta,) int32.
    """
    order = jax.random.permutation(key, store.length.size)
    return order, jnp.cumsum(store.length.reshape(-1)[order])


def replayed_transition(store: Trajectory, order: jax.Array, finished: jax.Array, index: jax.Array) -> Transition:
    """The transition that is replayed at `index`, () int32, counted over all trajectories.

    Each trajectory is replayed from its last transition to its first. Beyond the last of all transitions, the
    result means nothing.
    """
    place = jnp.minimum(jnp.sum(finished <= index), order.size - 1)
    domain, rank = jnp.divmod(order[place], store.length.shape[1])
    at = finished[place] - 1 - index
    return Transition(
        inputs=store.inputs[domain, rank, at],
        action=store.actions[domain, rank, at],
        reward=jax.tree.map(lambda leaf: leaf[domain, rank, at], store.rewards),
        next_inputs=store.inputs[domain, rank, at + 1],
        terminal=at == store.length[domain, rank] - 1,
    )


def replay_best(
    update: Callable, networks: Any, key: jax.Array, store: Trajectory, action_mask: jax.Array, alpha: float
) -> tuple[Any, jax.Array, jax.Array]:
    """Learn again from all kept trajectories, in random order, each one backwards.

    Args:
        update: of one transition, as `updates.td_update`.
        networks: what it updates.
        key: random key of the order.
        store: the kept trajectories.
        action_mask: (A,) bool, the actions that can be executed.
        alpha: learning rate, > 0.

    Returns:
        The networks, the sum () of |target - Q|, and the number () int32 of transitions.
    """
    if store.length.size == 0:
        return networks, jnp.float32(0), jnp.int32(0)
    order, finished = replay_order(key, store)

    def is_running(carry: tuple) -> jax.Array:
        return any_in_batch(carry[-1] < finished[-1])

    def replay_one(carry: tuple) -> tuple:
        networks, error_sum, index = carry
        active = index < finished[-1]
        transition = replayed_transition(store, order, finished, index)
        networks, _, error = update(networks, transition, action_mask, alpha, active)
        return networks, error_sum + jnp.where(active, jnp.abs(error), 0.0), index + 1

    networks, error_sum, _ = lax.while_loop(is_running, replay_one, (networks, jnp.float32(0), jnp.int32(0)))
    return networks, error_sum, finished[-1]
