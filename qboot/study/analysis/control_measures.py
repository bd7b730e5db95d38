"""What is measured on the cells of the control experiments (section VII): performance, steps, inputs."""

from collections.abc import Callable

import numpy as np

from qboot.study.analysis.curves import Curve, columns, moving_mean, source_curve
from qboot.study.analysis.measures import WINDOW
from qboot.study.analysis.statistics import on_grid
from qboot.study.store.artifacts import read_selection
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings


def performance_curve(cell: Run[CellSettings]) -> Curve:
    """Score on the source set, as a mean over the last WINDOW episodes."""
    return moving_mean(source_curve(cell, "QL"), WINDOW)


def steps_curve(cell: Run[CellSettings]) -> Curve:
    """Steps that an episode takes, as a mean over the last WINDOW episodes."""
    return moving_mean(Curve(*columns(cell, "qlearning.csv", "episode", "steps")), WINDOW)


def performance(cell: Run[CellSettings], share: float = 1.0) -> float:
    """Performance after a share of the episodes, in (0, 1]; at the end it is the paper's final performance."""
    return _after(performance_curve(cell), share)


def steps(cell: Run[CellSettings], share: float = 1.0) -> float:
    """Steps of an episode after a share of the episodes."""
    return _after(steps_curve(cell), share)


def average_performance(cell: Run[CellSettings]) -> float:
    """Mean score over all episodes: how fast a cell learns (figure 19)."""
    return float(source_curve(cell, "QL").scores.mean())


def n_inputs(cell: Run[CellSettings], share: float = 1.0) -> float:
    """Inputs of the Q-networks; they stay the same."""
    return float(read_selection(cell).sum())


# By name, each a function of a cell and of the share of its episodes that has passed.
CONTROL_MEASURES: dict[str, Callable[[Run[CellSettings], float], float]] = {
    "performance": performance,
    "steps of an episode": steps,
    "inputs": n_inputs,
}


def _after(curve: Curve, share: float) -> float:
    episode = max(np.floor(share * curve.episodes[-1]), curve.episodes[0])
    return float(on_grid(*curve, np.array([episode]))[0])
