"""Curves of a run that may still be going on: from its finished tables, or the checkpoint of what it does now."""

from typing import NamedTuple

import numpy as np

from qboot.study.analysis.curves import METHODS, Curve, columns, target_curve, to_the_end
from qboot.study.pipeline.transferring import PARTS
from qboot.study.store import files
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class CurveFiles(NamedTuple):
    """Where the curve of a method is while it grows."""

    table: str  # name of the finished file
    checkpoint: str  # name of the file before that
    columns: tuple[str, str]  # episodes and scores, in both


_FILES = {
    "source": {
        "QL": CurveFiles("qlearning.csv", "learn.checkpoint.npz", ("episode", "score")),
        "ER": CurveFiles("history.csv", "evolve.checkpoint.npz", ("episodes", "best")),
    },
    "target": {
        method: CurveFiles(f"{name}.csv", f"{name}.checkpoint.npz", (episodes, score))
        for method, (name, episodes, score) in PARTS.items()
    },
}


def curves_so_far(run: Run[RunSettings], which: str) -> dict[str, Curve]:
    """Learning on the "source" or "target" set, by method; without those that have not begun.

    Raises:
        RunError: if a file that is there cannot be used.
    """
    if which == "target" and run.file("transfer.csv").exists():
        return {method: target_curve(run, method) for method in METHODS}
    found = {method: _so_far(run, names) for method, names in _FILES[which].items()}
    if which == "target":
        found |= {method: to_the_end(run, curve) for method, curve in found.items() if method != "QL"}
    return {method: curve for method, curve in found.items() if len(curve.episodes)}


def _so_far(run: Run[RunSettings], names: CurveFiles) -> Curve:
    """The curve, without entries where there is nothing yet."""
    checkpoint = run.file(names.checkpoint)
    if run.file(names.table).exists():
        return Curve(*columns(run, names.table, *names.columns))
    try:
        arrays = files.read_npz(checkpoint)
    except RunError:
        if checkpoint.exists():
            raise
        return Curve(np.empty(0), np.empty(0))  # a stage removes its checkpoint when it is done
    return Curve(*(files.pick(arrays, f"history.{name}", checkpoint) for name in names.columns))
