"""How the commands of a learning trace are cut into linear actions (figure 3 of the paper)."""

import numpy as np
from matplotlib.collections import LineCollection

from qboot.envs.scene import BLUE, GREEN, GREY, RED
from qboot.extraction.segmentation import Segments, linear_segments, split_points
from qboot.extraction.traces import traces
from qboot.study.analysis.gathering import best_run
from qboot.study.figures.drawing import Drawn, new_figure
from qboot.study.pipeline.evolving import source_problem
from qboot.study.store.artifacts import read_lineage, task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

STEPS = 200


def segmentation(runs: list[Run[RunSettings]]) -> Drawn:
    """Commands of the best network, the strength of their second derivative, split points and linear models."""
    run = best_run(runs, "lineage.npz")
    best = read_lineage(run).take(slice(-1, None))
    longest = max(traces(source_problem(run, workers=1), best)[0], key=lambda trace: len(trace.commands))
    commands = longest.commands.T
    if commands.shape[1] < 3:
        raise RunError(f"the best network of {run.label} has no rollout of 3 timesteps: there is nothing to cut")
    points = np.flatnonzero(split_points(commands))
    segments = linear_segments(commands)
    strength = np.abs(np.diff(commands, n=2)).mean(axis=0)
    effectors = task_of(run).effectors
    end = min(STEPS, commands.shape[1])
    figure, axes = new_figure(len(effectors) + 1, 1, 8.0, 1.5 * (len(effectors) + 1), sharex=True)
    for row, name in enumerate(effectors):
        axes[row, 0].plot(commands[row, :end], color=BLUE, linewidth=1, label="command")
        axes[row, 0].add_collection(
            LineCollection(list(_models(segments, row)), color=RED, linewidth=1.8, label="linear model")
        )
        axes[row, 0].set(ylabel=name.replace("_", " "), ylim=(-0.05, 1.05))
    below = axes[-1, 0]
    below.plot(np.arange(1, end - 1), strength[: end - 2], color=GREY, linewidth=1, label="second derivative")
    below.axhline(strength.mean(), color=BLUE, linestyle="--", linewidth=1, label="its mean over the rollout")
    below.set(xlabel="timestep", ylabel="mean |u''|", xlim=(0, end))
    shown = points[points < end]
    for panel in axes[:, 0]:
        for point in shown:
            panel.axvline(point, color=GREEN, linewidth=0.9, alpha=0.8, zorder=0)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncol=2)
    below.legend(loc="lower left", bbox_to_anchor=(0, 1), ncol=2)
    shows = (
        f"The best network of {run.label}: {len(shown)} split points (green) in the first {end} timesteps, "
        f"{len(points)} in all {commands.shape[1]:,} of the rollout."
    )
    return Drawn(figure, shows, [run.label])


def _models(segments: Segments, effector: int) -> np.ndarray:
    """First and last point (n, 2, 2), step and value, of the linear models of one effector."""
    starts = np.cumsum(segments.durations) - segments.durations
    first = segments.intercepts[:, effector]
    last = first + segments.slopes[:, effector] * (segments.durations - 1)
    ends = starts + segments.durations - 1
    return np.stack([np.column_stack([starts, first]), np.column_stack([ends, last])], axis=1)
