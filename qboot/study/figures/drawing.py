"""Drawing on matplotlib: the look of all figures, scenes and the paths in them."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle

from qboot.envs.scene import BLUE, GREEN, GREY, RED, Scene, Shape

METHOD_COLOURS = {"QL": RED, "ER": BLUE, "ER+transfer": GREEN}
METHOD_LABELS = {"QL": "Q-learning", "ER": "ER (evolution)", "ER+transfer": "ER + transfer"}
STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "grid.color": "#dddddd",
    "legend.frameon": False,
}


class Drawn(NamedTuple):
    """A figure and what it shows."""

    figure: Figure
    shows: str  # in a sentence or two, with our numbers
    runs: list[str]  # labels of the runs that it was drawn from


def new_figure(rows: int, columns: int, width: float, height: float, **options) -> tuple[Figure, np.ndarray]:
    """A figure of `width` x `height` inches and its axes (rows, columns)."""
    figure = Figure((width, height), layout="compressed")  # panels of equal aspect stay close
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def grid_of(n: int, columns: int, width: float, height: float, margin: float = 0.0) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels of `width` x `height` inches, at most `columns` side by side, and those panels."""
    columns, rows = min(columns, n), -(-n // columns)
    figure, axes = new_figure(rows, columns, width * columns, height * rows + margin)
    for unused in axes.flat[n:]:
        unused.set_visible(False)
    return figure, list(axes.flat[:n])


def draw_scene(axes: Axes, scene: Scene, frame: int = 0) -> None:
    """Draw all shapes of a scene at one frame; what is not visible there is drawn hollow."""
    axes.set(xlim=(scene.left, scene.right), ylim=(scene.bottom, scene.top), aspect="equal", xticks=[], yticks=[])
    for side in axes.spines.values():
        side.set_visible(True)
    for shape in scene.shapes:
        _draw_shape(axes, shape, frame)


def draw_path(axes: Axes, shape: Shape, colours: list[str] | str, widths: float | np.ndarray = 1.2) -> None:
    """Draw where a shape went; `colours` and `widths` are one for all or one for each of its F - 1 steps."""
    points = np.column_stack([shape.x, shape.y])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    axes.add_collection(LineCollection(list(segments), colors=colours, linewidths=widths, capstyle="round", zorder=3))


def draw_boxes(axes: Axes, samples: list[np.ndarray], colours: Iterable[str]) -> None:
    """A box for each sample (n,) at 1, 2 and so on, and over it a dot for each value."""
    boxes = axes.boxplot(samples, widths=0.5, showfliers=False, patch_artist=True, medianprops={"color": "black"})
    for place, (box, values, colour) in enumerate(zip(boxes["boxes"], samples, colours, strict=False), start=1):
        box.set(facecolor=colour, alpha=0.35)
        axes.plot(place + side_by_side(len(values), 0.3), values, "o", color=colour, markersize=4, alpha=0.8)


def side_by_side(n: int, width: float) -> np.ndarray:
    """Offsets (n,) of dots, so that equal values can be counted; none for a single one."""
    return np.linspace(-width / 2, width / 2, n) if n > 1 else np.zeros(n)


def is_active(shape: Shape) -> np.ndarray:
    """Whether a shape was active at the end of each of its F - 1 steps, (F - 1,) bool."""
    active = np.zeros(1, bool) if shape.active is None else np.asarray(shape.active)
    return np.broadcast_to(active, (len(shape.x),))[1:]


def legend_patches(entries: dict[str, str]) -> list[Patch]:
    """Legend entries, label to colour."""
    return [Patch(color=colour, label=label) for label, colour in entries.items()]


def _draw_shape(axes: Axes, shape: Shape, frame: int) -> None:
    def at(values: np.ndarray) -> float:
        return values[frame if len(values) > 1 else 0]

    x, y = float(at(shape.x)), float(at(shape.y))
    colour = shape.active_colour if shape.active is not None and at(shape.active) else shape.colour
    is_hollow = shape.visible is not None and not at(shape.visible)
    look: dict[str, Any] = {"facecolor": "none" if is_hollow else colour, "edgecolor": colour if is_hollow else GREY}
    look |= {"linewidth": 1.2 if is_hollow else 0.5, "zorder": 2}
    if shape.half_height is None:
        axes.add_patch(Circle((x, y), shape.half_width, **look))
    else:
        corner = x - shape.half_width, y - shape.half_height
        axes.add_patch(Rectangle(corner, 2 * shape.half_width, 2 * shape.half_height, **look))
    if shape.heading is not None:
        ahead = float(at(shape.heading))
        length = 1.6 * shape.half_width
        axes.plot(
            [x, x + length * np.cos(ahead)], [y, y + length * np.sin(ahead)], color="black", linewidth=1.5, zorder=4
        )
