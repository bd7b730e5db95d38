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
N_INNER_WALLS = 4

# Walls in pixels: i0, j0, i1, j1, the last one included. The border is five pixels thick.
BORDER = ((0, 0, 199, 4), (0, 195, 199, 199), (0, 5, 4, 194), (195, 5, 199, 194))
ARENAS = {
    # a horizontal wall with a door, and below it a vertical wall with a door
    "A": ((5, 99, 126, 101), (174, 99, 194, 101), (99, 102, 101, 126), (99, 174, 101, 194)),
    # a vertical wall with a door in its upper half, and a horizontal wall with a door in the left half
    "B": ((99, 5, 101, 29), (99, 78, 101, 194), (5, 99, 29, 101), (78, 99, 98, 101)),
    # two horizontal walls that each leave a wide passage at one end, and two pillars
    "C": ((5, 66, 119, 68), (80, 132, 194, 134), (150, 96, 164, 101), (30, 99, 44, 104)),
}


class Placement(NamedTuple):
    """Where things are at the start of a rollout, in units and radians."""

    start: tuple[float, float, float]
    balls: tuple[tuple[float, float], ...]
    switch: tuple[float, float]
    basket: tuple[float, float]


PLACEMENTS = {
    "A": (
        Placement((100, 150, 0.2), ((280, 195), (200, 80), (450, 420), (200, 240)), (400, 60), (545, 255)),
        Placement((450, 520, -1.6), ((450, 400), (330, 150), (250, 220), (540, 200)), (150, 150), (450, 45)),
        Placement((150, 450, 0.0), ((230, 450), (450, 350), (120, 540), (450, 200)), (450, 530), (555, 450)),
    ),
    "B": (
        Placement((450, 530, -1.6), ((450, 380), (370, 250), (530, 450), (200, 150)), (530, 150), (450, 45)),
        Placement((160, 480, -1.6), ((160, 380), (80, 230), (450, 160), (70, 540)), (240, 480), (160, 45)),
        Placement((520, 160, 3.1), ((400, 160), (240, 240), (160, 420), (520, 520)), (450, 400), (45, 160)),
    ),
    "C": (
        Placement((80, 100, 0.0), ((250, 100), (450, 160), (300, 300), (480, 240)), (150, 60), (555, 100)),
        Placement((530, 530, 3.1), ((350, 530), (150, 450), (150, 250), (300, 350)), (450, 450), (45, 530)),
        Placement((540, 350, 3.1), ((400, 350), (250, 250), (100, 470), (450, 100)), (350, 240), (45, 350)),
    ),
}


class Arena(NamedTuple):
    """One domain as arrays; a set of domains has a leading axis D on each."""

    walls: jax.Array  # (8, 4) rectangles of pixels, i0, j0, i1, j1, the last included
    inner_walls: jax.Array  # (4, 4) those that can hide one place from another: the border cannot
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
    border = np.array(BORDER, np.float32)
    inner = pad_walls(np.array(ARENAS[name], np.float32), N_INNER_WALLS)
    place = PLACEMENTS[name][placement]
    fields = (
        np.concatenate([border, inner]), inner, place.start, place.balls, place.switch, place.basket,
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
