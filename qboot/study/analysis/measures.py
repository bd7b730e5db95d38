"""What is measured on a run, by name, to be set beside the paper's numbers."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from qboot.study.analysis.curves import (
    Curve,
    columns,
    generalisation,
    moving_mean,
    source_curve,
    target_curve,
    top_score,
)
from qboot.study.analysis.statistics import episodes_to, on_grid
from qboot.study.store import files
from qboot.study.store.artifacts import read_actions, read_arrays, read_inputs, read_lineage
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# A Q-learner's score varies from episode to episode, for it explores: its level is a mean over the last ones.
WINDOW = 20


class Sample(NamedTuple):
    """A measure of one run, or of several."""

    values: np.ndarray  # (n,), infinite where a goal was not reached
    given: float = np.inf  # of a time: how long the run (or the shortest of them) went on

    @staticmethod
    def join(samples: list["Sample"]) -> "Sample":
        """The values of several runs."""
        return Sample(np.concatenate([sample.values for sample in samples]), min(sample.given for sample in samples))


class Measure(NamedTuple):
    """How something is measured, and on which sizes of a study it depends."""

    unit: str
    read: Callable[[Run[RunSettings]], Sample]
    needs: tuple[str, ...]  # names of sizes (`qboot.study.analysis.sizes`)


def time_to_top(curve: Curve, top: float) -> Sample:
    """The first entry of a curve with the top score."""
    return Sample(np.array([episodes_to(*curve, top)]), float(curve.episodes[-1]))


def _one(value: float) -> Sample:
    return Sample(np.array([value], float))


def _generations_to_top(run: Run[RunSettings]) -> Sample:
    curve = Curve(*columns(run, "history.csv", "generation", "best"))
    return time_to_top(curve, top_score(run, "source"))


def _source_time(run: Run[RunSettings]) -> Sample:
    return time_to_top(source_curve(run, "QL"), top_score(run, "source"))


def _target_time(method: str, run: Run[RunSettings]) -> Sample:
    return time_to_top(target_curve(run, method), top_score(run, "target"))


def _target_score(method: str, run: Run[RunSettings]) -> Sample:
    """Score when Q-learning ends: its level over the last episodes, or the best of ER's population by then."""
    learned = target_curve(run, "QL")
    if method == "QL":
        return _one(moving_mean(learned, WINDOW).scores[-1])
    score = on_grid(*target_curve(run, method), learned.episodes[-1:])[0]
    # Before the first population is evaluated, ER has nothing to show.
    return _one(0.0 if np.isnan(score) else score)


def _extraction(name: str, run: Run[RunSettings]) -> Sample:
    return _one(float(files.pick(read_arrays(run, "actions.npz"), name, run.file("actions.npz"))))


_EVOLVING = ("population", "generations", "n_steps")
_LEARNING = (*_EVOLVING, "horizon", "episodes")

RUN_MEASURES = {
    "generations to the top score": Measure("generations", _generations_to_top, ("population", "n_steps")),
    "best score of ER on the source set": Measure(
        "score", lambda run: _one(source_curve(run, "ER").scores[-1]), _EVOLVING
    ),
    "lineage of the best-of-run": Measure(
        "individuals", lambda run: _one(len(read_lineage(run).ids)), ("generations", "horizon")
    ),
    "actions before clustering": Measure("segments", partial(_extraction, "n_segments"), (*_EVOLVING, "horizon")),
    "actions after clustering": Measure("actions", lambda run: _one(len(read_actions(run).durations)), ()),
    "duration of an action": Measure(
        "steps", lambda run: Sample(np.array(read_actions(run).durations, float)), (*_EVOLVING, "horizon")
    ),
    "distinct actions": Measure("actions", partial(_extraction, "n_distinct"), ()),
    "inputs of the Q-networks": Measure("inputs", lambda run: _one(len(read_inputs(run).sensors)), ()),
    "Q-learning episodes to the top score, source": Measure("episodes", _source_time, (*_EVOLVING, "horizon")),
    "generalisation of ER": Measure("score", lambda run: _one(generalisation(run, "ER")), _EVOLVING),
    "generalisation of Q-learning": Measure("score", lambda run: _one(generalisation(run, "QL")), _LEARNING),
    "Q-learning episodes to the top score, target": Measure("episodes", partial(_target_time, "QL"), _LEARNING),
    "ER episodes to the top score, target": Measure("episodes", partial(_target_time, "ER"), ("population", "n_steps")),
    "ER+transfer episodes to the top score, target": Measure(
        "episodes", partial(_target_time, "ER+transfer"), _EVOLVING
    ),
    "score of Q-learning, target": Measure("score", partial(_target_score, "QL"), _LEARNING),
    "score of ER at that time, target": Measure("score", partial(_target_score, "ER"), ("population", "n_steps")),
    "score of ER+transfer at that time, target": Measure("score", partial(_target_score, "ER+transfer"), _EVOLVING),
}
