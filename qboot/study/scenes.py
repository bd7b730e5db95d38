"""What a test looks like: shapes with colours and places, drawn alike on figures and on the replay's canvas.

A task says how it looks by one function, domain and states to scenes; there is one scene per point of view.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from qboot.envs import ball_collecting
from qboot.envs.types import Domain

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, RED, GREEN, PURPLE, YELLOW, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#f0c800", "#4d4d4d"


class Shape(NamedTuple):
    """One thing in a scene; leading axis F frames, or 1 for what never changes."""

    label: str
    x: np.ndarray  # (F,) centre
    y: np.ndarray  # (F,)
    half_width: float  # of a rectangle; the radius of a disc
    half_height: float | None  # None for a disc
    colour: str
    heading: np.ndarray | None = None  # (F,) radians from x towards y, drawn as a line from centre to rim
    visible: np.ndarray | None = None  # (F,) bool, always if None
    active: np.ndarray | None = None  # (F,) bool: drawn in `active_colour`, as is the path
    active_colour: str = RED


class Scene(NamedTuple):
    """One view of a test."""

    view: str  # from where
    left: float
    top: float
    right: float
    bottom: float  # below the top on the picture, whichever is greater
    shapes: tuple[Shape, ...]
    mover: Shape  # the one of the shapes whose path is drawn


def of_ball_collecting(domain: Domain, states: ball_collecting.BallState) -> list[Scene]:
    """The arena from above; states (F, ...). The robot is active while it carries a ball."""
    walls = [_wall(wall, domain.pixel) for wall in np.asarray(domain.walls) if wall[2] >= 0]
    posture = states.posture
    robot = Shape(
        "robot", posture.x, posture.y, float(domain.radius), None, BLUE,
        heading=posture.theta, active=np.asarray(states.carried).any(axis=1),
    )  # fmt: skip
    pulled = np.asarray(states.switch_pulled)
    present = np.asarray(jax.vmap(ball_collecting.present_balls)(np.asarray(states.taken), pulled))
    balls = [
        _disc("ball", centre, 9.0, YELLOW, visible=visible)
        for centre, visible in zip(domain.balls, present.T, strict=True)
    ]
    basket = _disc("basket", domain.basket, float(domain.basket_radius), GREEN)
    switch = _disc("switch", domain.switch, 12.0, PURPLE, active=pulled, active_colour="#e0d0d8")
    side = float(domain.side)
    return [Scene("from above", 0.0, 0.0, side, side, (basket, switch, *walls, *balls, robot), robot)]


def _disc(label: str, centre: np.ndarray, radius: float, colour: str, **changes) -> Shape:
    return Shape(label, np.asarray(centre[:1]), np.asarray(centre[1:]), radius, None, colour, **changes)


def _wall(pixels: np.ndarray, pixel: float) -> Shape:
    """A wall (4,) in pixels, the last ones included, as a rectangle in units."""
    centre, size = (pixels[:2] + pixels[2:]) / 2 * pixel, (pixels[2:] - pixels[:2] + 1) * pixel
    return Shape("wall", centre[:1], centre[1:], float(size[0]) / 2, float(size[1]) / 2, GREY)


# One row per task.
SCENES: dict[str, Callable[[Domain, Any], list[Scene]]] = {"ball_collecting": of_ball_collecting}
