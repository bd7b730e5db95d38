"""The replay of the best trajectories (section IV-E).

The paper keeps "the eta best trajectories". An episode visits several domains, and ours is the reading that
the eta best are kept *of each domain*: with one list for all, the domain in which rewards come soonest would
push the others out and the learner would forget them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.qlearning.networks import QNetworks
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import Earned
from qboot.qlearning.updates import Transition, anywhere, learn_from


class Trajectory(NamedTuple):
    """One test as a list of at most K transitions; a store of trajectories has leading axes (D, eta).

    Transition k leads from `inputs[k]` to `inputs[k + 1]`; the last one ends the test. An empty place of a
    store has length 0 and score 0.
    """

    inputs: jax.Array  # (K + 1, I) states at the decisions, and the final one
    actions: jax.Array  # (K,) int32
    earned: Earned  # two (K,)
    length: jax.Array  # () int32 transitions
    score: jax.Array  # () discounted return of the test, in primitive time


def empty_trajectory(capacity: int, n_inputs: int) -> Trajectory:
    """Return a trajectory without transitions, and room for `capacity` of them."""
    return Trajectory(
        inputs=jnp.zeros((capacity + 1, n_inputs)),
        actions=jnp.zeros(capacity, jnp.int32),
        earned=Earned(jnp.zeros(capacity), jnp.zeros(capacity)),
        length=jnp.int32(0),
        score=jnp.float32(0),
    )


def empty_store(n_domains: int, eta: int, capacity: int, n_inputs: int) -> Trajectory:
    """Return eta empty places for each domain."""
    trajectory = empty_trajectory(capacity, n_inputs)
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n_domains, eta, *leaf.shape)), trajectory)


def write(trajectory: Trajectory, index: jax.Array, transition: Transition) -> Trajectory:
    """Write a transition at `index`, () int32; length and score are set once, at the end of the test."""

    def put(leaf: jax.Array, value: jax.Array, index: jax.Array) -> jax.Array:
        return lax.dynamic_update_index_in_dim(leaf, value, index, 0)

    return trajectory._replace(
        inputs=put(trajectory.inputs, transition.next_inputs, index + 1),
        actions=put(trajectory.actions, transition.action, index),
        earned=jax.tree.map(lambda leaf, value: put(leaf, value, index), trajectory.earned, transition.earned),
    )


def keep_best(store: Trajectory, domain: jax.Array, trajectory: Trajectory) -> Trajectory:
    """Let a new trajectory take the place of the worst of its domain, () int32, if it scores more.

    Of equal scores the older trajectory stays. A return of 0 never beats an empty place, so it is never
    replayed.
    """
    if store.score.shape[1] == 0:
        return store
    place = jnp.argmin(store.score[domain])
    is_better = trajectory.score > store.score[domain, place]
    return jax.tree.map(
        lambda kept, new: kept.at[domain, place].set(jnp.where(is_better, new, kept[domain, place])),
        store,
        trajectory,
    )


def replay_order(key: jax.Array, store: Trajectory) -> tuple[jax.Array, jax.Array]:
    """Draw the order in which all kept trajectories are replayed.

    Returns their indices (D * eta,) in the flattened store, and after how many transitions each one is
    finished.
    """
    order = jax.random.permutation(key, store.length.size)
    return order, jnp.cumsum(store.length.reshape(-1)[order])


def replayed_transition(store: Trajectory, order: jax.Array, finished: jax.Array, index: jax.Array) -> Transition:
    """Return the transition that is replayed at `index`, () int32, counted over all trajectories.

    Each trajectory is replayed from its last transition to its first. Beyond the last of all transitions, the
    result means nothing.
    """
    place = jnp.minimum(jnp.sum(finished <= index), order.size - 1)
    domain, rank = jnp.divmod(order[place], store.score.shape[1])
    at = finished[place] - 1 - index
    return Transition(
        inputs=store.inputs[domain, rank, at],
        action=store.actions[domain, rank, at],
        earned=jax.tree.map(lambda leaf: leaf[domain, rank, at], store.earned),
        next_inputs=store.inputs[domain, rank, at + 1],
        terminal=at == store.length[domain, rank] - 1,
    )


def replay_best(
    networks: QNetworks, key: jax.Array, store: Trajectory, usable: jax.Array, settings: LearnerSettings
) -> tuple[QNetworks, jax.Array, jax.Array]:
    """Learn again from all kept trajectories, in random order, each one backwards.

    Returns the networks, the sum () of |target - Q|, and the number () of transitions.
    """
    if settings.eta == 0:
        return networks, jnp.float32(0), jnp.int32(0)
    order, finished = replay_order(key, store)

    def is_running(carry: tuple) -> jax.Array:
        return anywhere(carry[-1] < finished[-1])

    def replay_one(carry: tuple) -> tuple:
        networks, error_sum, index = carry
        active = index < finished[-1]
        transition = replayed_transition(store, order, finished, index)
        networks, _, error = learn_from(networks, transition, usable, settings.alpha, active)
        return networks, error_sum + jnp.where(active, jnp.abs(error), 0.0), index + 1

    networks, error_sum, _ = lax.while_loop(is_running, replay_one, (networks, jnp.float32(0), jnp.int32(0)))
    return networks, error_sum, finished[-1]
