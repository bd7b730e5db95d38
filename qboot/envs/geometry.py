"""Planar geometry of pixel walls: seen by rays, discs and lines of sight.

Walls are drawn on a lattice of pixels, as in the fastsim simulator: pixel (i, j) is the unit square around the point
(i, j). A wall is a rectangle of pixels `(M, 4)`, `i0, j0, i1, j1`, first and last index included. All lengths in this
file are pixels. A positive angle turns from x towards y. Everything is plain elementwise arithmetic, so that a whole
simulation fuses into one kernel.
"""

import jax
import jax.numpy as jnp
import numpy as np

# Padding is a wall too far away to be touched or seen.
FAR_WALL = (-2e6, -2e6, -1e6, -1e6)
# The squares of a wall's pixels reach half a pixel over the rectangle of their centres.
HALF_PIXEL = np.array([-0.5, -0.5, 0.5, 0.5], np.float32)


def entry_distances(origin: jax.Array, directions: jax.Array, walls: jax.Array) -> jax.Array:
    """Distance along each ray to its entry into each wall.

    Args:
        origin: (2,) common origin of the rays.
        directions: (..., 2) directions; distances are in multiples of their length.
        walls: (M, 4) rectangles x0, y0, x1, y1.

    Returns:
        (..., M) distances, infinite where a ray misses the wall.
    """
    direction_x, direction_y = directions[..., 0, None], directions[..., 1, None]
    # A ray parallel to a side has no crossing with it: a tiny slope puts the crossing far away instead of at 0/0.
    inverse_x = 1.0 / jnp.where(direction_x == 0.0, 1e-9, direction_x)
    inverse_y = 1.0 / jnp.where(direction_y == 0.0, 1e-9, direction_y)
    x_low, x_high = (walls[:, 0] - origin[0]) * inverse_x, (walls[:, 2] - origin[0]) * inverse_x
    y_low, y_high = (walls[:, 1] - origin[1]) * inverse_y, (walls[:, 3] - origin[1]) * inverse_y
    entry = jnp.maximum(jnp.minimum(x_low, x_high), jnp.minimum(y_low, y_high))
    leave = jnp.minimum(jnp.maximum(x_low, x_high), jnp.maximum(y_low, y_high))
    return jnp.where((leave >= entry) & (leave >= 0.0), jnp.maximum(entry, 0.0), jnp.inf)


def is_visible(origin: jax.Array, points: jax.Array, walls: jax.Array) -> jax.Array:
    """Whether no wall pixel lies on the line from the pixel of `origin` (2,) to those of `points` (N, 2); bool (N,)."""
    origin = jnp.round(origin)
    return jnp.all(entry_distances(origin, jnp.round(points) - origin, walls + HALF_PIXEL) > 1.0, axis=-1)


def range_to_walls(origin: jax.Array, ends: jax.Array, walls: jax.Array) -> jax.Array:
    """Distance from `origin` (2,) to the first wall pixel on the line to each of `ends` (N, 2); infinite if none; (N,).

    The line runs from pixel to pixel; the distance is that from the exact origin to the centre of the wall pixel.
    """
    pixel = jnp.round(origin)
    lines = jnp.round(ends) - pixel
    entry = jnp.min(entry_distances(pixel, lines, walls + HALF_PIXEL), axis=-1)
    # A quarter of a pixel further along the line lies inside the wall pixel, not on its edge.
    inside = jnp.minimum(entry, 1.0) + 0.25 / jnp.sqrt(jnp.sum(lines**2, axis=-1))
    offset = jnp.round(pixel + lines * inside[:, None]) - origin
    return jnp.where(entry <= 1.0, jnp.sqrt(jnp.sum(offset**2, axis=-1)), jnp.inf)


def nearest_offsets(centre: jax.Array, walls: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Offsets x (M,) and y (M,) from `centre` (2,) to the nearest point of each wall."""
    x = jnp.clip(centre[0], walls[:, 0], walls[:, 2]) - centre[0]
    y = jnp.clip(centre[1], walls[:, 1], walls[:, 3]) - centre[1]
    return x, y


def rectangles(picture: np.ndarray) -> np.ndarray:
    """Cover the walls of a picture exactly with disjoint rectangles.

    Greedy: each still uncovered wall pixel, row by row, is widened to the right and then downwards.

    Args:
        picture: (rows, columns) bool, True = wall, indexed [y, x].

    Returns:
        (M, 4) float32 walls.
    """
    left: np.ndarray = np.array(picture, bool)
    found = []
    while left.any():
        row, column = np.unravel_index(np.argmax(left), left.shape)
        run: np.ndarray = left[row, column:]
        width = len(run) if run.all() else int(np.argmin(run))
        full = np.all(left[row:, column : column + width], axis=1, keepdims=True)[:, 0]
        height = len(full) if full.all() else int(np.argmin(full))
        left[row : row + height, column : column + width] = False
        found.append((column, row, column + width - 1, row + height - 1))
    return np.array(found, np.float32).reshape(-1, 4)


def pad_walls(walls: np.ndarray, n_walls: int) -> np.ndarray:
    """Append walls out of reach up to (n_walls, 4); raises ValueError if there are more walls already."""
    if len(walls) > n_walls:
        raise ValueError(f"{len(walls)} walls do not fit into {n_walls} places")
    padding = np.full((n_walls - len(walls), 4), FAR_WALL, np.float32)
    return np.concatenate([np.asarray(walls, np.float32).reshape(-1, 4), padding])
