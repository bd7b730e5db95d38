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


# Drawn by the rule of `experiments/choose_domains.py`, seed 0.
PLACEMENTS = {
    "A": (
        Placement((175, 205, 0.3), ((335, 145), (245, 145), (460, 110), (385, 415)), (455, 325), (555, 215)),
        Placement((260, 230, 1.3), ((445, 260), (185, 165), (325, 145), (480, 360)), (215, 80), (455, 45)),
        Placement((205, 445, 0.8), ((415, 510), (365, 395), (405, 240), (290, 445)), (380, 150), (555, 405)),
    ),
    "B": (
        Placement((410, 540, 0.2), ((505, 475), (380, 420), (420, 180), (280, 160)), (455, 370), (555, 250)),
        Placement((295, 170, 1.4), ((145, 330), (220, 450), (175, 245), (230, 365)), (75, 410), (125, 555)),
        Placement((535, 470, -3.0), ((435, 335), (425, 230), (195, 165), (340, 185)), (525, 200), (485, 45)),
    ),
    "C": (
        Placement((430, 475, 2.2), ((320, 520), (150, 520), (345, 325), (200, 335)), (175, 435), (45, 360)),
        Placement((70, 60, 1.6), ((235, 125), (470, 220), (150, 110), (370, 315)), (330, 125), (455, 45)),
        Placement((325, 275, 1.7), ((170, 420), (360, 480), (455, 520), (205, 275)), (75, 405), (215, 555)),
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
    return among_walls(np.array(ARENAS[name], np.float32), PLACEMENTS[name][placement])


def among_walls(inner_walls: np.ndarray, place: Placement) -> Arena:
    """A placement in the border and among at most N_INNER_WALLS `inner_walls` (M, 4), in pixels."""
    inner = pad_walls(inner_walls, N_INNER_WALLS)
    fields = (
        np.concatenate([np.array(BORDER, np.float32), inner]), inner,
        place.start, place.balls, place.switch, place.basket,
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
