"""What a rollout looks like: shapes with colours and places, drawn alike on figures and on the players' canvas."""

from typing import NamedTuple

import numpy as np

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, RED, GREEN, PURPLE, YELLOW, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#f0c800", "#4d4d4d"
ORANGE, SKY, VIOLET = "#e69f00", "#56b4e9", "#7f4fa3"
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
    """A rollout, in coordinates of the picture."""

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


def disc(label: str, centre: np.ndarray, radius: float, colour: str, **changes) -> Shape:
    """A disc that stays at `centre` (2,)."""
    return Shape(label, np.asarray(centre[:1]), np.asarray(centre[1:]), radius, None, colour, **changes)
