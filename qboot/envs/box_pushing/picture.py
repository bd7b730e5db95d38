"""The arm in three dimensions: table, block, hand, and the space that the hand's sliders span."""

import itertools
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from qboot.envs.box_pushing import arm, domains
from qboot.envs.scene import BLUE, GREY, PALE_GREY, YELLOW
from qboot.envs.task import Task

WIDTH = 2.0  # of the block on the picture in three dimensions: the middle source size
# Corners of a box in units of its half sizes, and which of them a face (seen from outside) or an edge joins.
CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)), np.float32)
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
EDGES = [(a, b) for a, b in itertools.combinations(range(8), 2) if (CORNERS[a] != CORNERS[b]).sum() == 1]


def draw(task: Task) -> tuple[Figure, str]:
    """Table, block and hand at the start of a rollout, the space that the hand's sliders span, and what one sees."""
    domain = domains.block(WIDTH)
    state = jax.device_get(task.reset(jax.random.key(0), domain))
    figure = Figure((7.0, 4.2))
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    table_low = np.append(domains.TABLE_LOW, domains.TABLE_TOP - 0.02)
    table_high = np.append(domains.TABLE_HIGH, domains.TABLE_TOP)
    parts = {
        "table": ((table_low + table_high) / 2, (table_high - table_low) / 2, PALE_GREY),
        "block": (state.block, domain.half_size, YELLOW),
        "hand": (state.hand, arm.HALF_SIZE, BLUE),
    }
    for centre, half, colour in parts.values():
        corners = centre + CORNERS * half
        axes.add_collection3d(Poly3DCollection(corners[np.array(FACES)], facecolors=colour, shade=True))
    low, high = arm.STOP_LOW, arm.STOP_HIGH
    reach = (low + high) / 2 + CORNERS * (high - low) / 2
    axes.add_collection3d(Line3DCollection(reach[np.array(EDGES)], colors=GREY, linestyles=":", linewidths=1.0))
    start, tip = state.hand, state.hand - (0, 0.16, 0)
    axes.quiver(*start, *(tip - start), color="black", arrow_length_ratio=0.2, linewidth=1.5)
    axes.text(*(tip - (0, 0.02, 0)), "push", ha="right", va="center")
    axes.set(
        xlim=(-0.15, 0.65),
        ylim=(-0.55, 0.55),
        zlim=(0.6, 0.95),
        xlabel="x, m",
        ylabel="y, m",
        zlabel="z, m",
        zticks=(0.6, 0.7, 0.8, 0.9),
    )
    axes.set_box_aspect((0.8, 1.1, 0.35), zoom=1.1)  # as the limits: one scale for all
    axes.view_init(elev=32, azim=20)
    handles = [Patch(color=colour, label=name) for name, (*_, colour) in parts.items()]
    figure.legend(handles=handles, loc="upper left")
    shows = (
        f"Ours at the start of a rollout: a block of width {WIDTH:g}, the hand on its three sliders, and dotted the "
        "space between their stops. The hand must hit the middle of the block's right face, towards minus y."
    )
    return figure, shows
