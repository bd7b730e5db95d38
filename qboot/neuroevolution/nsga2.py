"""NSGA-II (paper, section III-B1): ranks, crowding, survivors and parents. All objectives are maximised.

Shape letters: P individuals, M objectives.
"""

import jax
import jax.numpy as jnp


def dominates(a: jax.Array, b: jax.Array) -> jax.Array:
    """Whether `a` (..., M) is at least equal to `b` (..., M) on all objectives and better on at least one."""
    return jnp.all(a >= b, axis=-1) & jnp.any(a > b, axis=-1)


def non_dominated_rank(objectives: jax.Array) -> jax.Array:
    """Front of each individual: 0 for the non-dominated, 1 for those left once front 0 is removed, and so on.

    Args:
        objectives: (P, M) to maximise, finite.

    Returns:
        (P,) int32 ranks.
    """
    objectives = _checked(objectives)
    dominated_by = dominates(objectives[None, :, :], objectives[:, None, :])

    def peel(carry):
        ranks, rank = carry
        left = ranks < 0
        front = left & ~jnp.any(dominated_by & left[None, :], axis=1)
        return jnp.where(front, rank, ranks), rank + 1

    start = jnp.full(objectives.shape[0], -1, jnp.int32), jnp.int32(0)
    return jax.lax.while_loop(lambda carry: jnp.any(carry[0] < 0), peel, start)[0]


def crowding_distance(objectives: jax.Array, ranks: jax.Array) -> jax.Array:
    """How much room each individual has in its front: the mean side of the box between its neighbours.

    The sides are in units of the front's extent in each objective; the ends of a front have infinite room.

    Args:
        objectives: (P, M) to maximise.
        ranks: (P,) fronts, from `non_dominated_rank`.

    Returns:
        (P,) float32 distances, possibly infinite.
    """
    objectives, ranks = _checked(objectives), jnp.asarray(ranks)
    n = objectives.shape[0]

    def along(values: jax.Array) -> jax.Array:
        order = jnp.lexsort((values, ranks))
        value, rank = values[order], ranks[order]
        change = rank[1:] != rank[:-1]
        first, last = jnp.append(True, change), jnp.append(change, True)
        extent = jax.ops.segment_max(value, rank, n)[rank] - jax.ops.segment_min(value, rank, n)[rank]
        gap = jnp.roll(value, -1) - jnp.roll(value, 1)
        # In a front without extent there is nothing to tell its inner members apart.
        inner = jnp.where(extent > 0, gap / jnp.where(extent > 0, extent, 1.0), 0.0)
        return jnp.zeros(n).at[order].set(jnp.where(first | last, jnp.inf, inner))

    return jnp.mean(jax.vmap(along, in_axes=1)(objectives), axis=0)


def select(objectives: jax.Array, n: int) -> jax.Array:
    """Indices (n,) of the survivors: whole fronts in order, the last one by decreasing crowding distance.

    Raises:
        ValueError: if n is not between 1 and P.
    """
    objectives = _checked(objectives)
    if not 1 <= n <= objectives.shape[0]:
        raise ValueError(f"cannot select {n} of {objectives.shape[0]} individuals")
    ranks = non_dominated_rank(objectives)
    return survivors(ranks, crowding_distance(objectives, ranks), n)


def survivors(ranks: jax.Array, crowding: jax.Array, n: int) -> jax.Array:
    """Indices (n,) of the best by the crowded comparison: lower rank, then larger crowding distance."""
    return jnp.lexsort((-crowding, ranks))[:n]


def tournament(key: jax.Array, ranks: jax.Array, crowding: jax.Array, n: int) -> jax.Array:
    """Indices (n,) of parents: each the better of two random individuals by rank, then crowding, then coin."""
    ranks, crowding = jnp.asarray(ranks), jnp.asarray(crowding)
    key_pairs, key_coin = jax.random.split(key)
    a, b = jax.random.randint(key_pairs, (2, n), 0, ranks.shape[0])
    a_wins = (ranks[a] < ranks[b]) | ((ranks[a] == ranks[b]) & (crowding[a] > crowding[b]))
    tie = (ranks[a] == ranks[b]) & (crowding[a] == crowding[b])
    coin = jax.random.bernoulli(key_coin, shape=(n,))
    return jnp.where(a_wins | (tie & coin), a, b)


def _checked(objectives: jax.Array) -> jax.Array:
    objectives = jnp.asarray(objectives)
    if objectives.ndim != 2 or objectives.shape[0] == 0 or objectives.shape[1] == 0:
        raise ValueError(
            f"objectives must have shape (individuals, objectives), both at least 1, not {objectives.shape}"
        )
    return objectives
