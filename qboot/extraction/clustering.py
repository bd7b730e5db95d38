"""Clustering by methods with names, fuzzy c-means first (paper, section IV-C; Bezdek 1981).

Another method is a function (features (n, F), settings, seed) -> Clustering, and a row of CLUSTERINGS.
Shape letters: n points, F features, c clusters.
"""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.extraction.threads import one_thread

if TYPE_CHECKING:  # the settings choose one of the methods
    from qboot.extraction.actions import ActionSettings

# Choosing the first centres needs no more points than this, however many there are to cluster.
MAX_INITIAL_POINTS = 20_000
# Points of a sum. XLA spreads larger ones over its threads, whose number would decide the last bits.
BLOCK = 256
# Squared distance (in units of the data's variance) below which a point counts as lying on a centre.
ON_CENTRE = 1e-30


class Clustering(NamedTuple):
    """What a clustering found."""

    centres: np.ndarray  # (c, F) float64
    memberships: np.ndarray  # (n, c) float32, rows sum to 1
    iterations: int  # until it stopped


def fuzzy_c_means(
    points: np.ndarray,
    n_clusters: int,
    m: float,
    seed: int,
    *,
    max_iterations: int = 300,
    tolerance: float = 1e-4,
) -> tuple[np.ndarray, np.ndarray]:
    """Centres (c, F) and memberships (n, c) of fuzzy clusters: `cluster` without the count of iterations."""
    found = cluster(points, n_clusters, m, seed, max_iterations=max_iterations, tolerance=tolerance)
    return found.centres, found.memberships


def cluster(
    points: np.ndarray,
    n_clusters: int,
    m: float,
    seed: int,
    *,
    max_iterations: int = 300,
    tolerance: float = 1e-4,
    restarts: int = 1,
) -> Clustering:
    """Minimise sum_ij u_ij^m |x_i - c_j|^2 over centres c and memberships u, from k-means++ centres.

    Args:
        points: (n, F) finite.
        n_clusters: c, 1 .. n.
        m: fuzziness, > 1. Near 1 it is k-means; the larger, the more the centres draw together: with m = 2
            and noisy data in several dimensions, many of them may coincide.
        seed: decides the first centres.
        max_iterations: updates of the centres at most, >= 1.
        tolerance: stop when no coordinate of a centre moves by more than this times the largest standard
            deviation of a feature, >= 0. (A norm of the change of memberships would grow with their number.)
        restarts: how often to start, from other centres each time, >= 1; the smallest sum wins.

    Raises:
        ValueError: when an argument lies outside the range given above.
    """
    points = np.asarray(points, np.float64)
    _check(points, n_clusters, m, max_iterations, tolerance, restarts)
    # Single precision is enough once the data are centred and have a spread of 1.
    origin, unit = points.mean(axis=0), points.std(axis=0).max() or 1.0
    points = ((points - origin) / unit).astype(np.float32)
    blocks = _in_blocks(points)
    best = np.inf
    for start in range(restarts):
        # scikit-learn takes seeds of 32 bits.
        centres = jnp.asarray(_initial_centres(points, n_clusters, (seed * restarts + start) % 2**32))
        for iteration in range(1, max_iterations + 1):  # noqa: B007 (the last value is a result)
            centres, moved = _update(blocks, centres, m)
            if moved <= tolerance:
                break
        memberships, total = _assign(blocks, centres, m)
        if total < best:
            memberships = np.asarray(memberships).reshape(-1, n_clusters)[: len(points)]
            best, found = total, Clustering(np.asarray(centres, np.float64), memberships, iteration)
    return found._replace(centres=found.centres * unit + origin)


@one_thread()
def _initial_centres(points: np.ndarray, n_clusters: int, seed: int) -> np.ndarray:
    from sklearn.cluster import kmeans_plusplus  # takes a second to import: only those who cluster pay

    n_enough = max(MAX_INITIAL_POINTS, n_clusters)
    if len(points) > n_enough:
        points = points[np.random.default_rng(seed).choice(len(points), n_enough, replace=False)]
    return kmeans_plusplus(points, n_clusters, random_state=seed)[0]


class _Blocks(NamedTuple):
    """Points, filled up to whole blocks."""

    points: jax.Array  # (blocks, BLOCK, F) float32
    is_point: jax.Array  # (blocks, BLOCK) float32: 1, and 0 where it is filled up


def _in_blocks(points: np.ndarray) -> _Blocks:
    missing = -len(points) % BLOCK
    filled = np.pad(points, [(0, missing), (0, 0)]).reshape(-1, BLOCK, points.shape[1])
    is_point = np.pad(np.ones(len(points), np.float32), (0, missing)).reshape(-1, BLOCK)
    return _Blocks(jnp.asarray(filled), jnp.asarray(is_point))


@jax.jit
def _update(blocks: _Blocks, centres: jax.Array, m: float) -> tuple[jax.Array, jax.Array]:
    """Centres as means weighted by memberships^m, and the largest move of a coordinate."""

    def add(sums: tuple[jax.Array, jax.Array], block: _Blocks) -> tuple[tuple[jax.Array, jax.Array], None]:
        weights = jnp.exp(m * _log_memberships(block.points, centres, m)) * block.is_point[:, None]
        return (sums[0] + weights.T @ block.points, sums[1] + weights.sum(axis=0)), None

    nothing = (jnp.zeros_like(centres), jnp.zeros(len(centres), centres.dtype))
    (weighted, total), _ = jax.lax.scan(add, nothing, blocks)
    updated = weighted / jnp.maximum(total, jnp.finfo(total.dtype).tiny)[:, None]
    return updated, jnp.abs(updated - centres).max()


@jax.jit
def _assign(blocks: _Blocks, centres: jax.Array, m: float) -> tuple[jax.Array, jax.Array]:
    """Memberships (blocks, BLOCK, c), and the sum that is minimised."""

    def add(total: jax.Array, block: _Blocks) -> tuple[jax.Array, jax.Array]:
        memberships = jnp.exp(_log_memberships(block.points, centres, m))
        squared = jnp.square(block.points[:, None, :] - centres[None, :, :]).sum(axis=-1)
        return total + (memberships**m * squared * block.is_point[:, None]).sum(), memberships

    total, memberships = jax.lax.scan(add, jnp.zeros((), centres.dtype), blocks)
    return memberships, total


def _log_memberships(points: jax.Array, centres: jax.Array, m: float) -> jax.Array:
    """Logarithms (n, c) of u_ij = d_ij^(-2/(m-1)) / sum_k d_ik^(-2/(m-1)); the powers would overflow."""
    squared = jnp.square(points[:, None, :] - centres[None, :, :]).sum(axis=-1)
    return jax.nn.log_softmax(-jnp.log(jnp.maximum(squared, ON_CENTRE)) / (m - 1), axis=1)


def _check(points: np.ndarray, n_clusters: int, m: float, max_iterations: int, tolerance: float, restarts: int) -> None:
    if points.ndim != 2 or not points.size:
        raise ValueError(f"points must have shape (points, features), both at least 1, got {points.shape}.")
    if not np.isfinite(points).all():
        raise ValueError("points must be finite: they hold NaN or infinite values.")
    if not 1 <= n_clusters <= len(points):
        raise ValueError(f"n_clusters must lie between 1 and the {len(points)} points, got {n_clusters}.")
    if not m > 1:
        raise ValueError(f"m must be greater than 1, got {m}.")
    if max_iterations < 1:
        raise ValueError(f"max_iterations must be at least 1, got {max_iterations}.")
    if not tolerance >= 0:
        raise ValueError(f"tolerance must not be negative, got {tolerance}.")
    if restarts < 1:
        raise ValueError(f"restarts must be at least 1, got {restarts}.")


def _fuzzy_c_means(features: np.ndarray, settings: "ActionSettings", seed: int) -> Clustering:
    return cluster(
        features,
        settings.n_actions,
        settings.fuzziness,
        seed,
        max_iterations=settings.max_iterations,
        tolerance=settings.tolerance,
        restarts=settings.restarts,
    )


def _k_means(features: np.ndarray, settings: "ActionSettings", seed: int) -> Clustering:
    """Centres that each stand for the points nearest to them (Lloyd's algorithm)."""
    from sklearn.cluster import KMeans

    found = _fitted(
        KMeans(
            settings.n_actions,
            n_init=settings.restarts,
            max_iter=settings.max_iterations,
            tol=settings.tolerance,
            random_state=seed,
        ),
        features,
    )
    memberships = np.eye(settings.n_actions, dtype=np.float32)[found.labels_]
    return Clustering(found.cluster_centers_.astype(np.float64), memberships, int(found.n_iter_))


def _gaussian_mixture(features: np.ndarray, settings: "ActionSettings", seed: int) -> Clustering:
    """The means of a mixture of normal distributions with full covariances, by expectation maximisation."""
    from sklearn.mixture import GaussianMixture

    found = _fitted(
        GaussianMixture(
            settings.n_actions,
            n_init=settings.restarts,
            max_iter=settings.max_iterations,
            tol=settings.tolerance,
            random_state=seed,
        ),
        np.asarray(features, np.float64),
    )
    return Clustering(found.means_, found.predict_proba(features).astype(np.float32), int(found.n_iter_))


@one_thread()
def _fitted(model: Any, features: np.ndarray) -> Any:
    """A model of scikit-learn, fitted; that centres coincide or move on is told by what is reported of them."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(features)


CLUSTERINGS: dict[str, Callable[[np.ndarray, "ActionSettings", int], Clustering]] = {
    "fuzzy_c_means": _fuzzy_c_means,
    "k_means": _k_means,
    "gaussian_mixture": _gaussian_mixture,
}
"""(scaled features (n, F), settings, seed) -> `settings.n_actions` clusters; the seed decides all that is random."""
