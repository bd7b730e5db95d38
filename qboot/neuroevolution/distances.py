"""Behavioural distances d(x, y) and the diversity that they give (paper, sections III-B2, V-A2 and VI-A2).

A distance is a descriptor of behaviours, by a recorder, and a metric: the behavioural diversity of each individual x in
the population P,

    BD(x) = 1 / size(P) sum_{y in P} d(x, y).

Of several distances the one in force changes during a run (`evolve.diversity_in_force`), and it alone is recorded.
Shape letters: P individuals, n rollouts of each, T steps, W words of 32 bits, S sensors, E effectors.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
from rapidfuzz.distance import Levenshtein
from rapidfuzz.process import cdist

from qboot.envs.task import Domain, Task, TaskState
from qboot.neuroevolution.recorders import Recorder, Timestep, keep_rows, no_summary

ENTROPY_BINS = 9  # appendix B, entropy discretization
WORD = 32  # bits
STEPS_IN_CACHE = 256  # of all individuals, gone through channel by channel while they are there


class Distance(NamedTuple):
    """How behaviours are described and compared."""

    recorder: Recorder  # one rollout -> descriptor
    metric: Callable[[Task, Any], np.ndarray | jax.Array]  # (task, descriptors (P, n, ...)) -> BD (P,) float32


def n_channels(task: Task) -> int:
    """S + E."""
    return len(task.sensors) + len(task.effectors)


def _channels(timestep: Timestep) -> jax.Array:
    return jnp.concatenate([timestep.state.observation, timestep.command])


# Ad hoc: the task's own outcome, for instance where the balls are in the end.


def _no_row(task: Task, domain: Domain, summary: tuple, timestep: Timestep) -> tuple[tuple, tuple]:
    return summary, ()


def _outcome(task: Task, domain: Domain, summary: tuple, rows: tuple, final: TaskState) -> jax.Array:
    return task.outcome(domain, final)


@jax.jit
def adhoc(descriptors: jax.Array) -> jax.Array:
    """Mean Euclidean distance of the outcomes of all rollouts, (P,); descriptors (P, n, k)."""
    chex.assert_rank(descriptors, 3)
    return _mean_euclidean(descriptors.reshape(descriptors.shape[0], -1))


# Hamming: sensors and effectors binarised at half range, a bit each; 0 once the rollout is over.


def _bits(task: Task, domain: Domain, summary: tuple, timestep: Timestep) -> tuple[tuple, jax.Array]:
    on = (_channels(timestep) >= 0.5).astype(jnp.uint32)
    parts = [on[start : start + WORD] for start in range(0, len(on), WORD)]
    words = [jnp.sum(part << jnp.arange(len(part), dtype=jnp.uint32), dtype=jnp.uint32) for part in parts]
    return summary, jnp.stack(words)


@partial(jax.jit, static_argnames="n_channels")
def hamming(descriptors: jax.Array, n_channels: int) -> jax.Array:
    """Mean share of differing bits, (P,); descriptors (P, n, T, W) uint32, a bit per channel.

    The distances to all others add up bit by bit: where c of P individuals have a bit set, an individual with it set
    differs from P - c others and one without from c. That is linear in P, and exact.
    """
    chex.assert_shape(descriptors, (None, None, None, -(-n_channels // WORD)))
    n_individuals = descriptors.shape[0]
    words = descriptors.reshape(n_individuals, -1, descriptors.shape[-1])
    n_steps = words.shape[1]

    def add(totals: jax.Array, start: int | jax.Array, size: int) -> jax.Array:
        some = jax.lax.dynamic_slice_in_dim(words, start, size, axis=1)
        bits = (
            ((some[..., channel // WORD] >> (channel % WORD)) & 1).astype(jnp.int32) for channel in range(n_channels)
        )
        counts = ((each, jnp.sum(each, axis=0)) for each in bits)
        return totals + jnp.stack([jnp.sum(c + each * (n_individuals - 2 * c), axis=1) for each, c in counts])

    size = min(STEPS_IN_CACHE, n_steps)
    totals = jnp.zeros((n_channels, n_individuals), jnp.int32)
    totals = jax.lax.fori_loop(0, n_steps // size, lambda i, totals: add(totals, i * size, size), totals)
    totals = add(totals, n_steps - n_steps % size, n_steps % size)
    differing = jnp.zeros(n_individuals, jnp.float32)
    for total in totals:  # one after the other: the order in which they are rounded
        differing += total.astype(jnp.float32)
    return differing / float(n_individuals * n_channels * n_steps)  # the whole number may not fit into 32 bits


# Entropy: how often each channel was in each of nine bins.


def _no_counts(task: Task) -> jax.Array:
    return jnp.zeros((ENTROPY_BINS, n_channels(task)), jnp.int32)


def _count(task: Task, domain: Domain, summary: jax.Array, timestep: Timestep) -> tuple[jax.Array, tuple]:
    bins = jnp.clip((_channels(timestep) * ENTROPY_BINS).astype(jnp.int32), 0, ENTROPY_BINS - 1)
    return summary + (bins == jnp.arange(ENTROPY_BINS)[:, None]).astype(jnp.int32), ()


def _counts(task: Task, domain: Domain, summary: jax.Array, rows: tuple, final: TaskState) -> jax.Array:
    return summary.T


@jax.jit
def entropy(descriptors: jax.Array) -> jax.Array:
    """Mean Euclidean distance of the channels' entropies, (P,); descriptors (P, n, S + E, bins) counts.

    Entropies are taken over all rollouts and normalised by log(bins), so that they lie in [0, 1].
    """
    chex.assert_rank(descriptors, 4)
    counts = jnp.sum(descriptors, axis=1).astype(jnp.float32)
    share = counts / jnp.maximum(jnp.sum(counts, axis=-1, keepdims=True), 1.0)
    logs = jnp.log(jnp.where(share > 0, share, 1.0))
    return _mean_euclidean(-jnp.sum(share * logs, axis=-1) / jnp.log(counts.shape[-1]))


# Trajectory: cells of the discretised path; -1 once the rollout is over.


def _cell(task: Task, domain: Domain, summary: tuple, timestep: Timestep) -> tuple[tuple, jax.Array]:
    return summary, 1 + task.position(domain, timestep.state)


def _cells(task: Task, domain: Domain, summary: tuple, rows: jax.Array, final: TaskState) -> jax.Array:
    return rows[:: task.trajectory_period] - 1


def trajectory(descriptors: np.ndarray) -> np.ndarray:
    """Mean edit distance (unit costs) of the trajectories, (P,), as a share of the number of cells.

    Descriptors are cells >= 0 (P, n, cells) int32, -1 once a rollout is over.
    """
    descriptors = np.asarray(descriptors)
    chex.assert_rank(descriptors, 3)
    n_individuals, n_rollouts, n_cells = descriptors.shape
    # Cells are compared as characters; numbered anew, as there are fewer characters than integers.
    cells, numbers = np.unique(descriptors, return_inverse=True)
    characters = np.array([chr(i) if cell >= 0 else "" for i, cell in enumerate(cells)], object)[numbers]
    total = np.zeros(n_individuals)
    for rollout in range(n_rollouts):
        strings = ["".join(path) for path in characters.reshape(descriptors.shape)[:, rollout]]
        total += cdist(strings, strings, scorer=Levenshtein.distance, dtype=np.int32).sum(axis=1)
    return (total / (n_individuals * n_rollouts * n_cells)).astype(np.float32)


def _mean_euclidean(points: jax.Array) -> jax.Array:
    """Mean distance of each of `points` (P, k) to all of them, (P,)."""
    return jnp.mean(jnp.sqrt(jnp.sum((points[:, None] - points[None]) ** 2, axis=-1)), axis=1)


DISTANCES = {
    "adhoc": Distance(Recorder(no_summary, _no_row, _outcome), lambda task, descriptors: adhoc(descriptors)),
    "hamming": Distance(
        Recorder(no_summary, _bits, keep_rows), lambda task, descriptors: hamming(descriptors, n_channels(task))
    ),
    "entropy": Distance(Recorder(_no_counts, _count, _counts), lambda task, descriptors: entropy(descriptors)),
    "trajectory": Distance(Recorder(no_summary, _cell, _cells), lambda task, descriptors: trajectory(descriptors)),
}
