"""Figures of the control experiments (figures 17 to 19 of the paper), each from the cells of one task by condition."""

import itertools
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from qboot.envs.scene import BLUE, GREEN, GREY, ORANGE, RED, VIOLET
from qboot.study.analysis.control_measures import (
    CellsByCondition,
    average_performance,
    common_episodes,
    n_inputs,
    performance,
    performance_curve,
    steps_curve,
)
from qboot.study.analysis.curves import Curve, columns, common_grid, top_score
from qboot.study.analysis.measures import WINDOW
from qboot.study.analysis.statistics import median_and_quartiles, quartiles
from qboot.study.figures.drawing import Drawn, draw_boxes, new_figure
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings

COLOURS = (RED, GREEN, BLUE, ORANGE, VIOLET)


def learning_by_actions(cells: CellsByCondition) -> Drawn:
    """Scores against episodes with each set of actions; below them, where episodes differ in length, their steps."""
    varies = _lengths_vary(cells)
    figure, axes = new_figure(1 + varies, 1, 7.5, 4.2 + 2.6 * varies, sharex=True)
    medians = _draw_curves(axes[0, 0], cells, performance_curve)
    _score_axis(axes[0, 0], cells)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=len(cells))
    if varies:
        _draw_curves(axes[1, 0], cells, steps_curve)
        axes[1, 0].set(ylabel="steps of an episode")
        axes[1, 0].grid(axis="y")
    axes[-1, 0].set(xlabel="episodes")
    ends = "; ".join(f"{name} {median:.3g}" for name, median in medians.items())
    shows = (
        f"Median at the end: {ends}. Bands reach from the lower to the upper quartile; a curve is the mean of the last "
        f"{WINDOW} episodes."
    )
    return Drawn(figure, shows, _labels(cells))


def performance_by_sensors(cells: CellsByCondition) -> Drawn:
    """Final performance, and the number of inputs below it, with each choice of sensors."""
    figure, axes = new_figure(2, 1, 7.5, 6.0, sharex=True)
    episodes = common_episodes(cells)
    _draw_boxes(axes[0, 0], cells, performance)
    _score_axis(axes[0, 0], cells, "final performance")
    _draw_boxes(axes[1, 0], cells, n_inputs)
    axes[1, 0].set(ylabel="inputs of the Q-networks", ylim=(0, None))
    axes[1, 0].set_xticks(range(1, len(cells) + 1), list(cells))
    ends = "; ".join(
        f"{name} {np.median(_values(some, performance, episodes)):.3g} with "
        f"{np.median(_values(some, n_inputs, episodes)):.0f} inputs"
        for name, some in cells.items()
    )
    return Drawn(figure, f"Medians: {ends}. A dot is a learner.", _labels(cells))


def performance_by_n_actions(cells: CellsByCondition) -> Drawn:
    """Final and average performance against the number of actions."""
    figure, [[axes]] = new_figure(1, 1, 7.5, 4.2)
    numbers, episodes = [int(name) for name in cells], common_episodes(cells)
    for (label, measure), colour in zip(
        (("final performance", performance), ("average performance", average_performance)), (RED, BLUE), strict=True
    ):
        found = [quartiles(_values(some, measure, episodes)) for some in cells.values()]
        axes.plot(numbers, [each.median for each in found], "o-", color=colour, markersize=4, label=label)
        bounds = [each.lower for each in found], [each.upper for each in found]
        axes.fill_between(numbers, *bounds, color=colour, alpha=0.2, linewidth=0)
    _score_axis(axes, cells)
    axes.set(xlabel="number of actions", xticks=numbers)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    ends = "; ".join(
        f"{name} actions {np.median(_values(some, performance, episodes)):.3g} "
        f"(average {np.median(_values(some, average_performance, episodes)):.3g})"
        for name, some in cells.items()
    )
    return Drawn(figure, f"Median of the final performance: {ends}. Bands are quartiles.", _labels(cells))


def _draw_curves(axes: Axes, cells: CellsByCondition, read: Callable[[Run[CellSettings]], Curve]) -> dict[str, float]:
    """Draw median and quartiles of each condition, all for as many episodes; return the medians at the end."""
    medians, episodes = {}, common_episodes(cells)
    for colour, (name, some) in zip(itertools.cycle(COLOURS), cells.items(), strict=False):
        curves = [Curve(*(column[:episodes] for column in read(cell))) for cell in some]
        grid = common_grid(curves)
        found = median_and_quartiles(curves, grid)
        axes.fill_between(grid, found.lower, found.upper, color=colour, alpha=0.2, linewidth=0)
        axes.plot(grid, found.median, color=colour, linewidth=2, label=f"{name}, n = {len(some)}")
        medians[name] = float(found.median[-1])
    return medians


def _draw_boxes(axes: Axes, cells: CellsByCondition, measure: Callable[[Run[CellSettings], int], float]) -> None:
    episodes = common_episodes(cells)
    draw_boxes(axes, [_values(some, measure, episodes) for some in cells.values()], itertools.cycle(COLOURS))


def _score_axis(axes: Axes, cells: CellsByCondition, label: str = "score") -> None:
    top = top_score(_first(cells), "source")
    axes.axhline(top, color=GREY, linestyle=":", linewidth=1)
    axes.set(ylim=(-0.03 * top, 1.06 * top), ylabel=f"{label}, of {top:.0f}")
    axes.grid(axis="y")


def _lengths_vary(cells: CellsByCondition) -> bool:
    """Whether some episodes took more steps than others."""
    steps = [columns(cell, "qlearning.csv", "steps")[0] for some in cells.values() for cell in some]
    return bool(np.ptp(np.concatenate(steps)) > 0)


def _first(cells: CellsByCondition) -> Run[CellSettings]:
    return next(iter(cells.values()))[0]


def _values(
    some: list[Run[CellSettings]], measure: Callable[[Run[CellSettings], int], float], episodes: int
) -> np.ndarray:
    return np.array([measure(cell, episodes) for cell in some])


def _labels(cells: CellsByCondition) -> list[str]:
    return [f"{name}-{cell.settings.seed}" for name, some in cells.items() for cell in some]
