"""What a test looks like: shapes with colours and places, drawn alike on figures and on the replay's canvas.

A task says how it looks by one function, from a domain and states to a scene.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.ball_collecting import dynamics as ball_collecting
from qboot.envs.box_pushing import arm
from qboot.envs.box_pushing import domains as blocks
from qboot.envs.box_pushing import dynamics as box_pushing
from qboot.envs.task import Domain

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, RED, GREEN, PURPLE, YELLOW, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#f0c800", "#4d4d4d"
# Where height 0 lies on the picture of the table, in metres below x = 0: the side view ends under the view from above.
SIDE_VIEW = 1.6
PALE_PURPLE, PALE_GREY = "#e6d5de", "#e4e7ea"


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
    active_label: str = ""


class Scene(NamedTuple):
    """A test, in coordinates of the picture."""

    left: float
    top: float
    right: float
    bottom: float  # below the top on the picture, whichever is greater
    shapes: tuple[Shape, ...]
    movers: tuple[Shape, ...]  # those of the shapes whose paths are drawn

    @property
    def legend(self) -> dict[str, str]:
        """What the colours mean, label to colour."""
        always = {shape.label: shape.colour for shape in self.shapes}
        return always | {shape.active_label: shape.active_colour for shape in self.shapes if shape.active_label}


def of_ball_collecting(domain: Domain, states: ball_collecting.BallState) -> Scene:
    """The arena from above; states (F, ...). The robot is active while it carries a ball."""
    walls = [_wall(wall, domain.pixel) for wall in np.asarray(domain.walls) if wall[2] >= 0]
    posture = states.posture
    robot = Shape(
        "robot", posture.x, posture.y, float(domain.radius), None, BLUE,
        heading=posture.theta, active=np.asarray(states.carried).any(axis=1), active_label="robot carrying a ball",
    )  # fmt: skip
    pulled = np.asarray(states.switch_pulled)
    present = np.asarray(jax.vmap(ball_collecting.present_balls)(np.asarray(states.taken), pulled))
    balls = [
        _disc("ball", centre, 9.0, YELLOW, visible=visible)
        for centre, visible in zip(domain.balls, present.T, strict=True)
    ]
    basket = _disc("basket", domain.basket, float(domain.basket_radius), GREEN)
    switch = _disc(
        "switch", domain.switch, 12.0, PURPLE, active=pulled, active_colour=PALE_PURPLE, active_label="pulled switch"
    )
    side = float(domain.side)
    return Scene(0.0, 0.0, side, side, (basket, switch, *walls, *balls, robot), (robot,))


def _disc(label: str, centre: np.ndarray, radius: float, colour: str, **changes) -> Shape:
    return Shape(label, np.asarray(centre[:1]), np.asarray(centre[1:]), radius, None, colour, **changes)


def _wall(pixels: np.ndarray, pixel: float) -> Shape:
    """A wall (4,) in pixels, the last ones included, as a rectangle in units."""
    centre, size = (pixels[:2] + pixels[2:]) / 2 * pixel, (pixels[2:] - pixels[:2] + 1) * pixel
    return Shape("wall", centre[:1], centre[1:], float(size[0]) / 2, float(size[1]) / 2, GREY)


def of_box_pushing(domain: blocks.Block, states: box_pushing.PushState) -> Scene:
    """The table from above and, below that, from the side; states (F, ...). To the left is minus y, in metres.

    The hand is active in contact.
    """
    table_low, table_high = np.append(blocks.TABLE_LOW, 0.0), np.append(blocks.TABLE_HIGH, blocks.TABLE_TOP)
    hand, block, in_contact = (np.asarray(part) for part in (states.hand, states.block, states.done))

    def shapes(axis: int, place: Callable[[np.ndarray], np.ndarray]) -> tuple[Shape, ...]:
        """The view in which `axis` is upright, at `place` on the picture."""

        def box(label: str, centre: np.ndarray, half: np.ndarray, colour: str, **changes) -> Shape:
            sides = float(half[1]), float(half[axis])
            return Shape(label, centre[:, 1], place(centre[:, axis]), *sides, colour, **changes)

        return (
            box("table", (table_low + table_high)[None] / 2, (table_high - table_low) / 2, PALE_GREY),
            box("block", block, domain.half_size, YELLOW),
            box("hand", hand, arm.HALF_SIZE, BLUE, active=in_contact, active_label="hand in contact"),
        )

    from_above = shapes(0, lambda x: x)
    from_side = shapes(2, lambda z: SIDE_VIEW - z)
    bottom = SIDE_VIEW - blocks.TABLE_TOP + 0.04
    return Scene(-0.5, 0.0, 0.3, bottom, (*from_above, *from_side), (from_above[-1], from_side[-1]))


def _blocks() -> list[tuple[str, Domain]]:
    widths = {"source": blocks.SOURCE_WIDTHS, "target": blocks.TARGET_WIDTHS}
    return [(f"{which}, width {width:g}", blocks.block(width)) for which in widths for width in widths[which]]


def _arenas() -> list[tuple[str, Domain]]:
    return [
        (f"{name}, placement {placement}", arenas.arena(name, placement))
        for name in arenas.ARENAS
        for placement in range(len(arenas.PLACEMENTS[name]))
    ]


class Look(NamedTuple):
    """How a task is drawn."""

    scene: Callable[[Domain, Any], Scene]  # (domain, states (F, ...)) -> scene
    domains: Callable[[], list[tuple[str, Domain]]]  # all domains with their names
    note: str  # what one should know of the domains


# One row per task.
LOOKS = {
    "ball_collecting": Look(
        of_ball_collecting,
        _arenas,
        "The robot's line points ahead. Hollow balls appear when the switch is pulled. The source set of a run is one "
        "arena with placements 0 and 1, its target set the two other arenas with three placements each. Arena A has "
        "the original's walls; B, C and all placements are ours, in the same spirit.",
    ),
    "box_pushing": Look(
        of_box_pushing,
        _blocks,
        "From above and, below that, from the side; the arm pushes to the left. Hand and block start at random "
        "places; one start is drawn for each block. The source sizes are the original's, the target sizes ours, "
        "between and below them.",
    ),
}
