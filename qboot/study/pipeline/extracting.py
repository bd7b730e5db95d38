"""The stage extract: from the lineage's learning traces to the actions and sensors of a Q-learner."""

import warnings

import numpy as np

from qboot.extraction.actions import cluster_actions
from qboot.extraction.lost_commands import lost
from qboot.extraction.segmentation import LONG_SEGMENTS, Segments, segment
from qboot.extraction.sensors import select
from qboot.extraction.traces import Trace, traces
from qboot.study.pipeline.evolving import source_problem
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files
from qboot.study.store.artifacts import read_lineage, task_of
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Share of a lineage that may replay to other scores. What records traces is another program than evolution ran, and
# may round the last bit otherwise; where a contact is just made or just missed, that is a reward more or less.
ROUNDED_OTHERWISE = 0.05


class ReplaysOtherwise(RunError):
    """A lineage that scores otherwise than it was saved with when it is played again."""


def extract_stage(run: Run[RunSettings], output: Output, workers: int) -> None:
    """Actions and sensors from the traces of the best-of-run's lineage: actions.npz, sensors.npz."""
    flow = replayed(run, workers)
    actions, report = cluster_actions(segments_of(run, flow), run.settings.actions, run.settings.seed)
    if words := lost(np.concatenate([trace.commands for trace in flow]), actions, task_of(run).effectors):
        warnings.warn(f"{run.folder}: no extracted action gives {words}: what needs it cannot be learned", stacklevel=2)
    output.write_npz("actions.npz", files.to_arrays(actions) | files.to_arrays(report))
    observed = at_decisions(run, flow) if run.settings.sensors.moments == "decisions" else flow
    selection = select(observed, run.settings.sensors)
    # A sensor that never varies has no model.
    arrays = {"selected": selection.selected} | files.to_arrays(selection.report)
    output.write_npz("sensors.npz", arrays, may_be_nan=("alphas", "explained"))


def replayed(run: Run[RunSettings], workers: int) -> list[Trace]:
    """The learning traces: the best-of-run's lineage played again.

    Raises:
        ReplaysOtherwise: if it does not reach the scores that it was saved with, but for a few networks, which are
            warned of.
    """
    ancestors = read_lineage(run)
    with Progress(f"extract {run.label}", "network", len(ancestors.ids)) as progress:
        flow, scores = traces(source_problem(run, workers), ancestors, progress.update)
    different = ~np.isclose(scores, ancestors.scores, rtol=1e-5, atol=1e-5)
    if different.mean() > ROUNDED_OTHERWISE:
        raise ReplaysOtherwise(
            f"{run.file('lineage.npz')} does not replay to the scores it was saved with, {different.sum()} of its "
            f"{len(different)} networks score otherwise: it was made by another version of qboot, with other XLA flags "
            f'({run.file("config.json")} tells both) or on other hardware. docs/reliability.md, "Another processor", '
            "tells with which flags it may; or evolve again on this one"
        )
    if different.any():
        warnings.warn(
            f"{different.sum()} of the {len(different)} networks of {run.file('lineage.npz')} replay to another score "
            "than they were saved with: rounding",
            stacklevel=2,
        )
    return flow


def at_decisions(run: Run[RunSettings], flow: list[Trace]) -> list[Trace]:
    """The traces at the steps alone at which one of their actions begins."""
    settings = run.settings.actions
    found = []
    for trace in flow:
        durations = LONG_SEGMENTS["cut"](segment([trace.commands], settings), settings.max_duration).durations
        starts = np.cumsum(durations) - durations
        found.append(Trace(*(field[starts] for field in trace)))
    return found


def segments_of(run: Run[RunSettings], flow: list[Trace]) -> Segments:
    """All linear segments of the traces' commands."""
    return segment((trace.commands for trace in flow), run.settings.actions)
