"""The domains of ball collecting: arenas A, B, C with three placements each (paper, figure 4), as arrays.

Arena A has the walls of the recorded original. B and C, and every placement, are ours, of the same area and in the
same spirit; `docs/fidelity.md` tells how they were chosen.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.geometry import pad_walls

SIDE = 600.0  # units
PIXEL = 3.0  # units; walls are drawn on 200 x 200 pixels
RADIUS = 20.0
LASER_RANGE = 320.0  # 16 radii
BASKET_RADIUS = 50.0
N_WALLS = 8

# Walls in pixels: i0, j0, i1, j1, the last one included. The border is five pixels thick.
BORDER = ((0, 0, 199, 4), (0, 195, 199, 199), (0, 5, 4, 194), (195, 5, 199, 194))
ARENAS = {
    # a horizontal wall with a door, and below it a vertical wall with a door
    "A": ((5, 99, 126, 101), (174, 99, 194, 101), (99, 102, 101, 126), (99, 174, 101, 194)),
    # a vertical wall with a door in the middle, and a horizontal wall with a door in the left half
    "B": ((99, 5, 101, 75), (99, 123, 101, 194), (5, 99, 29, 101), (77, 99, 98, 101)),
    # two horizontal walls that each leave a wide passage at one end, and a pillar
    "C": ((5, 66, 119, 68), (80, 132, 194, 134), (150, 96, 164, 101), (30, 99, 44, 104)),
}


class Placement(NamedTuple):
    """Where things are at the start of a test, in units and radians."""

    start: tuple[float, float, float]
    balls: tuple[tuple[float, float], ...]
    switch: tuple[float, float]
    basket: tuple[float, float]


PLACEMENTS = {
    "A": (
        Placement((100, 400, 0.8), ((150, 75), (150, 225), (300, 75), (300, 225)), (480, 150), (75, 540)),
        Placement((450, 450, -2.3), ((150, 75), (150, 225), (300, 75), (300, 225)), (480, 150), (75, 540)),
        Placement((450, 150, 2.3), ((150, 75), (150, 225), (300, 75), (300, 225)), (480, 150), (75, 540)),
    ),
}


class Arena(NamedTuple):
    """One domain as arrays; a set of domains has a leading axis D on each."""

    walls: jax.Array  # (8, 4) rectangles of pixels, i0, j0, i1, j1, the last included
    start: jax.Array  # (3,) x, y, theta
    balls: jax.Array  # (4, 2)
    switch: jax.Array  # (2,)
    basket: jax.Array  # (2,)
    basket_radius: jax.Array  # ()
    radius: jax.Array  # () of the robot
    laser_range: jax.Array  # ()
    pixel: jax.Array  # () side of a wall pixel
    side: jax.Array  # () of the arena


def arena(name: str, placement: int) -> Arena:
    """One domain.

    Raises:
        ValueError: for an arena other than A, B, C or a placement other than 0, 1, 2.
    """
    if name not in ARENAS:
        raise ValueError(f"unknown arena {name!r}: choose one of {', '.join(ARENAS)}")
    if placement not in range(len(PLACEMENTS[name])):
        raise ValueError(f"unknown placement {placement!r} of arena {name}: choose 0, 1 or 2")
    walls = np.array(BORDER + ARENAS[name], np.float32)
    place = PLACEMENTS[name][placement]
    fields = (
        pad_walls(walls, N_WALLS), place.start, place.balls, place.switch, place.basket,
        BASKET_RADIUS, RADIUS, LASER_RANGE, PIXEL, SIDE,
    )  # fmt: skip
    return Arena(*(jnp.asarray(field, jnp.float32) for field in fields))


def stack(domains: list[Arena]) -> Arena:
    """A set of domains: the same arrays with a leading axis D."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *domains)


def source_domains(source: str) -> Arena:
    """The source set: one arena with two placements (section V-A4)."""
    return stack([arena(source, placement) for placement in (0, 1)])


def target_domains(source: str) -> Arena:
    """The target set: the two other arenas with three placements each (section V-A4)."""
    arena(source, 0)  # says clearly if the name is unknown
    return stack([arena(name, placement) for name in ARENAS if name != source for placement in range(3)])
