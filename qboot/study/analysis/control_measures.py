"""What is measured on the cells of the control experiments (section VII): performance, steps, inputs."""

from collections.abc import Callable

import numpy as np

from qboot.study.analysis.curves import Curve, columns, moving_mean, source_curve
from qboot.study.analysis.measures import WINDOW
from qboot.study.analysis.statistics import on_grid
from qboot.study.store.artifacts import read_selection
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings

CellsByCondition = dict[str, list[Run[CellSettings]]]  # the finished ones of one experiment


def performance_curve(cell: Run[CellSettings]) -> Curve:
    """Score on the source set, as a mean over the last WINDOW episodes."""
    return moving_mean(source_curve(cell, "QL"), WINDOW)


def steps_curve(cell: Run[CellSettings]) -> Curve:
    """Steps that an episode takes, as a mean over the last WINDOW episodes."""
    return moving_mean(Curve(*columns(cell, "qlearning.csv", "episode", "steps")), WINDOW)


def common_episodes(cells: CellsByCondition) -> int:
    """Episodes that all cells of an experiment had; one that serves another experiment too may have had more."""
    return min(cell.settings.episodes for some in cells.values() for cell in some)


def performance(cell: Run[CellSettings], episodes: int) -> float:
    """Performance after some episodes; at the end it is the paper's final performance."""
    return _after(performance_curve(cell), episodes)


def steps(cell: Run[CellSettings], episodes: int) -> float:
    """Steps of an episode after some episodes."""
    return _after(steps_curve(cell), episodes)


def average_performance(cell: Run[CellSettings], episodes: int) -> float:
    """Mean score over the first episodes: how fast a cell learns (figure 19)."""
    return float(source_curve(cell, "QL").scores[:episodes].mean())


def n_inputs(cell: Run[CellSettings], episodes: int) -> float:
    """Inputs of the Q-networks; they stay the same."""
    return float(read_selection(cell).sum())


# By name, each a function of a cell and of the episodes after which it is measured.
CONTROL_MEASURES: dict[str, Callable[[Run[CellSettings], int], float]] = {
    "performance": performance,
    "steps of an episode": steps,
    "inputs": n_inputs,
}


def _after(curve: Curve, episodes: int) -> float:
    return float(on_grid(*curve, np.array([max(episodes, curve.episodes[0])]))[0])
