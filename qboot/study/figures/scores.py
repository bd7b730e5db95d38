"""Figures of scores: learning on the source set and on the target set, and scores there without learning."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from qboot.envs.scene import GREY
from qboot.study.analysis.curves import (
    METHODS,
    Curve,
    common_grid,
    generalisation,
    moving_mean,
    source_curve,
    target_curve,
    top_score,
)
from qboot.study.analysis.gathering import gather
from qboot.study.analysis.measures import WINDOW
from qboot.study.analysis.so_far import curves_so_far
from qboot.study.analysis.statistics import mann_whitney, median_and_quartiles
from qboot.study.figures.drawing import METHOD_COLOURS, METHOD_LABELS, Drawn, draw_boxes, new_figure
from qboot.study.pipeline.loop import SECONDS_BETWEEN_SAVES
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

HOW = (
    "ER is the best of the population; Q-learning is the mean of the last "
    f"{WINDOW} episodes, thin the median of single ones."
)


def learning_on_source(runs: list[Run[RunSettings]]) -> Drawn:
    """Scores of ER and of Q-learning on the source set, against episodes."""
    return _learning(runs, ("QL", "ER"), source_curve, "source")


def learning_on_target(runs: list[Run[RunSettings]]) -> Drawn:
    """Scores of Q-learning, ER and ER + transfer on the target set, against episodes."""
    return _learning(runs, METHODS, target_curve, "target")


def so_far(run: Run[RunSettings]) -> Drawn:
    """Scores of one run that may still be going on, against episodes: a panel per set of domains."""
    sets = {which: found for which in ("source", "target") if (found := curves_so_far(run, which))}
    if not sets:
        raise RunError(
            f"{run.folder} has no curve yet: a stage first saves after some {SECONDS_BETWEEN_SAVES:.0f} seconds"
        )
    figure, axes = new_figure(1, len(sets), 7.5 * len(sets), 4.2)
    ends = []
    for panel, (which, found) in zip(axes[0], sets.items(), strict=True):
        words = _draw_learning(panel, {method: [curve] for method, curve in found.items()}, run, which)
        ends.append(f"{which} set: {words}")
    return Drawn(figure, f"{'; '.join(ends)}. {HOW}", [run.label])


def generalising(runs: list[Run[RunSettings]]) -> Drawn:
    """Scores on the target set without learning there, a box per method."""
    found = gather(runs, lambda run: [generalisation(run, method) for method in ("ER", "QL")]).found
    if not found:
        raise RunError("no run has generalisation.csv: run the stage transfer")
    evolved, learned = np.array(list(found.values())).T
    figure, [[axes]] = new_figure(1, 1, 5.0, 4.0)
    draw_boxes(axes, [evolved, learned], [METHOD_COLOURS["ER"], METHOD_COLOURS["QL"]])
    top = top_score(runs[0], "target")
    axes.set_xticks([1, 2], [METHOD_LABELS["ER"], METHOD_LABELS["QL"]])
    axes.set(ylim=(-0.04 * top, 1.04 * top), ylabel=f"score on the target set, of {top:.0f}")
    comparison = mann_whitney(learned, evolved)
    axes.set_title(f"Mann-Whitney p = {comparison.p_value:.3g}, A12 = {comparison.a12:.2f}, n = {len(evolved)}")
    shows = (
        f"Medians of {np.median(learned):g} (Q-learning) and {np.median(evolved):g} (ER) of {top:.0f}, "
        f"p = {comparison.p_value:.3g}; a Q-policy scores higher than a network with probability "
        f"{comparison.a12:.2f} (A12, ties half). A dot is a run."
    )
    return Drawn(figure, shows, [run.label for run in found])


def _learning(
    runs: list[Run[RunSettings]],
    methods: tuple[str, ...],
    read: Callable[[Run[RunSettings], str], Curve],
    which: str,
) -> Drawn:
    curves = {method: found for method in methods if (found := _curves(runs, read, method))}
    if not curves:
        raise RunError(f"no run has learned on the {which} set: run the stages")
    figure, [[axes]] = new_figure(1, 1, 7.5, 4.2)
    ends = _draw_learning(axes, {method: list(found.values()) for method, found in curves.items()}, runs[0], which)
    shows = f"Median at the end: {ends}. Bands reach from the lower to the upper quartile over runs. {HOW}"
    drawn = dict.fromkeys(run for found in curves.values() for run in found)
    return Drawn(figure, shows, [run.label for run in drawn])


def _draw_learning(axes: Axes, curves: dict[str, list[Curve]], run: Run[RunSettings], which: str) -> str:
    """Draw the curves of each method on a set of domains of a `run`, and its top score; where they end, in words."""
    top = top_score(run, which)
    ends = []
    for method, some in curves.items():
        last, score = _draw_method(axes, method, some)
        ends.append(f"{METHOD_LABELS[method]} {score:.3g} after {last:,.0f} episodes")
    axes.axhline(top, color=GREY, linestyle=":", linewidth=1)
    axes.text(
        0.01, top, f"top score {top:.0f}", transform=axes.get_yaxis_transform(), va="bottom", color=GREY, fontsize=9
    )
    axes.set(xscale="log", xlabel="episodes", ylabel=f"score on the {which} set", ylim=(-0.03 * top, 1.12 * top))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=len(curves))
    return "; ".join(ends)


def _curves(
    runs: list[Run[RunSettings]], read: Callable[[Run[RunSettings], str], Curve], method: str
) -> dict[Run[RunSettings], Curve]:
    """The curves of those runs that have one."""
    return gather(runs, lambda run: read(run, method)).found


def _draw_method(axes: Axes, method: str, curves: list[Curve]) -> tuple[float, float]:
    """Draw the median and quartiles over runs of one method; the last episode and the median there."""
    colour, grid = METHOD_COLOURS[method], common_grid(curves)
    if method == "QL":
        axes.plot(grid, median_and_quartiles(curves, grid).median, color=colour, linewidth=0.6, alpha=0.4)
        curves = [moving_mean(curve, WINDOW) for curve in curves]
    over_runs = median_and_quartiles(curves, grid)
    axes.fill_between(grid, over_runs.lower, over_runs.upper, color=colour, alpha=0.2, linewidth=0)
    label = f"{METHOD_LABELS[method]}, n = {len(curves)}"
    axes.plot(grid, over_runs.median, color=colour, linewidth=2, label=label)
    return float(grid[-1]), float(over_runs.median[-1])
