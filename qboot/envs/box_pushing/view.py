"""How box pushing is drawn: the table from above and from the side."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qboot.envs.box_pushing import arm, domains, dynamics
from qboot.envs.box_pushing.domains import Block
from qboot.envs.scene import BLUE, PALE_GREY, YELLOW, Scene, Shape
from qboot.envs.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTE = (
    "From above and, below that, from the side; the arm pushes to the left. Hand and block start at random "
    "places; one start is drawn for each block. The source sizes are the original's, the target sizes ours, "
    "between and below them."
)
# Where height 0 lies on the picture of the table, in metres below x = 0: the side view ends under the view from above.
SIDE_VIEW = 1.6


def scene(domain: Block, states: dynamics.PushState) -> Scene:
    """The table from above and, below that, from the side; states (F, ...). To the left is minus y, in metres.

    The hand is active in contact.
    """
    table_low, table_high = np.append(domains.TABLE_LOW, 0.0), np.append(domains.TABLE_HIGH, domains.TABLE_TOP)
    hand, block, in_contact = (np.asarray(part) for part in (states.hand, states.block, states.done))

    def shapes(axis: int, place: Callable[[np.ndarray], np.ndarray]) -> tuple[Shape, ...]:
        """The view in which `axis` is upright, at `place` on the picture."""

        def box(label: str, centre: np.ndarray, half: np.ndarray, colour: str, **changes) -> Shape:
            sides = float(half[1]), float(half[axis])
            return Shape(label, centre[:, 1], place(centre[:, axis]), *sides, colour, **changes)

        return (
            box("table", (table_low + table_high)[None] / 2, (table_high - table_low) / 2, PALE_GREY),
            box("block", block, np.asarray(domain.half_size), YELLOW),
            box("hand", hand, arm.HALF_SIZE, BLUE, active=in_contact, active_label="hand in contact"),
        )

    from_above = shapes(0, lambda x: x)
    from_side = shapes(2, lambda z: SIDE_VIEW - z)
    bottom = SIDE_VIEW - domains.TABLE_TOP + 0.04
    return Scene(-0.5, 0.0, 0.3, bottom, (*from_above, *from_side), (from_above[-1], from_side[-1]))


def all_domains() -> list[tuple[str, Block]]:
    """All six blocks with their names."""
    widths = {"source": domains.SOURCE_WIDTHS, "target": domains.TARGET_WIDTHS}
    return [(f"{which}, width {width:g}", domains.block(width)) for which in widths for width in widths[which]]


def picture(task: Task) -> tuple["Figure", str]:
    """The arm in three dimensions, and what the picture shows."""
    from qboot.envs.box_pushing.picture import draw  # matplotlib is for those who draw

    return draw(task)
