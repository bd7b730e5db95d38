"""How ball collecting is drawn: the arena from above."""

import jax
import numpy as np

from qboot.envs.ball_collecting import domains, dynamics
from qboot.envs.ball_collecting.domains import Arena
from qboot.envs.scene import BLUE, GREEN, GREY, PALE_PURPLE, PURPLE, YELLOW, Scene, Shape, disc

NOTE = (
    "The robot's line points ahead. Hollow balls appear when the switch is pulled. The source set of a run is one "
    "arena with placements 0 and 1, its target set the two other arenas with three placements each. Arena A has "
    "the original's walls; B, C and all placements are ours, in the same spirit."
)


def scene(domain: Arena, states: dynamics.BallState) -> Scene:
    """The arena from above; states (F, ...). The robot is active while it carries a ball."""
    walls = [_wall(wall, float(domain.pixel)) for wall in np.asarray(domain.walls) if wall[2] >= 0]
    x, y, theta = (np.asarray(leaf) for leaf in states.posture)
    carrying: np.ndarray = np.any(np.asarray(states.carried), axis=1)
    robot = Shape(
        "robot", x, y, float(domain.radius), None, BLUE,
        heading=theta, active=carrying, active_label="robot carrying a ball",
    )  # fmt: skip
    pulled = np.asarray(states.switch_pulled)
    present = np.asarray(jax.vmap(dynamics.present_balls)(states.taken, states.switch_pulled))
    balls = [
        disc("ball", centre, 9.0, YELLOW, visible=visible)
        for centre, visible in zip(np.asarray(domain.balls), present.T, strict=True)
    ]
    basket = disc("basket", np.asarray(domain.basket), float(domain.basket_radius), GREEN)
    switch = disc(
        "switch",
        np.asarray(domain.switch),
        12.0,
        PURPLE,
        active=pulled,
        active_colour=PALE_PURPLE,
        active_label="pulled switch",
    )
    side = float(domain.side)
    return Scene(0.0, 0.0, side, side, (basket, switch, *walls, *balls, robot), (robot,))


def all_domains() -> list[tuple[str, Arena]]:
    """All nine domains with their names."""
    return [
        (f"{name}, placement {placement}", domains.arena(name, placement))
        for name in domains.ARENAS
        for placement in range(len(domains.PLACEMENTS[name]))
    ]


def _wall(pixels: np.ndarray, pixel: float) -> Shape:
    """A wall (4,) in pixels, the last ones included, as a rectangle in units."""
    centre, size = (pixels[:2] + pixels[2:]) / 2 * pixel, (pixels[2:] - pixels[:2] + 1) * pixel
    return Shape("wall", centre[:1], centre[1:], float(size[0]) / 2, float(size[1]) / 2, GREY)
