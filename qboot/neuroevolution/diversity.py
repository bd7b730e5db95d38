"""Behavioural diversity BD(x), the mean distance of x to all of the population (paper, section III-B2).

Each function takes the descriptions of P individuals in n tests, from the recorder of the same name, and returns
BD (P,) float32. Distances of an individual are means over its tests, except the entropy, which is taken over all.
"""

import jax
import jax.numpy as jnp
import numpy as np
from rapidfuzz.distance import Levenshtein
from rapidfuzz.process import cdist


@jax.jit
def hamming(descriptions: jax.Array) -> jax.Array:
    """Mean share of differing bits; descriptions (P, n, T) uint16, one bit per channel.

    The distances to all others add up bit by bit: where c of P individuals have a bit set, an individual with it set
    differs from P - c others and one without from c. That is linear in P, and exact.
    """
    n_individuals = descriptions.shape[0]
    words = descriptions.reshape(n_individuals, -1)
    n_channels = 16
    differing = jnp.zeros(n_individuals, jnp.float32)
    for channel in range(n_channels):
        bits = ((words >> channel) & 1).astype(jnp.int32)
        count = jnp.sum(bits, axis=0)
        differing += jnp.sum(count + bits * (n_individuals - 2 * count), axis=1)
    return differing / (n_individuals * n_channels * words.shape[1])


@jax.jit
def entropy(descriptions: jax.Array) -> jax.Array:
    """Mean Euclidean distance of the channels' entropies; descriptions (P, n, channels, bins) counts.

    Entropies are normalised by log(bins), so that they lie in [0, 1].
    """
    counts = jnp.sum(descriptions, axis=1).astype(jnp.float32)
    share = counts / jnp.maximum(jnp.sum(counts, axis=-1, keepdims=True), 1.0)
    logs = jnp.log(jnp.where(share > 0, share, 1.0))
    return _mean_euclidean(-jnp.sum(share * logs, axis=-1) / jnp.log(counts.shape[-1]))


@jax.jit
def adhoc(descriptions: jax.Array) -> jax.Array:
    """Mean Euclidean distance of the outcomes of all tests; descriptions (P, n, k)."""
    return _mean_euclidean(descriptions.reshape(descriptions.shape[0], -1))


def trajectory(descriptions: np.ndarray) -> np.ndarray:
    """Mean edit distance (unit costs) of the trajectories; descriptions (P, n, cells), -1 after the end.

    The distance is given as a share of the number of cells.
    """
    descriptions = np.asarray(descriptions)
    n_individuals, n_tests, n_cells = descriptions.shape
    total = np.zeros(n_individuals)
    for test in range(n_tests):
        strings = ["".join(chr(cell + 1) for cell in cells if cell >= 0) for cells in descriptions[:, test]]
        total += cdist(strings, strings, scorer=Levenshtein.distance, dtype=np.uint16).sum(axis=1)
    return (total / (n_individuals * n_tests * n_cells)).astype(np.float32)


def _mean_euclidean(points: jax.Array) -> jax.Array:
    """Mean distance of each of `points` (P, k) to all of them, (P,)."""
    return jnp.mean(jnp.sqrt(jnp.sum((points[:, None] - points[None]) ** 2, axis=-1)), axis=1)


DIVERSITIES = {"adhoc": adhoc, "hamming": hamming, "entropy": entropy, "trajectory": trajectory}
