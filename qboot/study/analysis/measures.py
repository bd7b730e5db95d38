"""What is measured on a run, by name, to be set beside the paper's numbers."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

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
from qboot.study.analysis.statistics import (
    Quartiles,
    median_interval,
    on_grid,
    quartiles,
    time_interval,
    times_to_goal,
)
from qboot.study.store import files
from qboot.study.store.artifacts import lineage_length, read_actions, read_arrays, read_inputs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# A Q-learner's score varies from episode to episode, for it explores: its level is a mean over the last ones.
WINDOW = 20
# What is done with an evolved run needs one that is done with the task: the paper's generations, or the top score.
EVOLVED = "evolved"


class Summary(NamedTuple):
    """A measure over runs."""

    mean: float  # NaN for a time
    quartiles: Quartiles[float]  # infinite where a goal was not reached
    interval: tuple[float, float]  # 95 % bootstrap interval of the median
    given: float = np.inf  # of a time: how long the shortest of the runs went on
    not_reached: int | None = None  # of a time: runs that never reached the goal


class Climb(NamedTuple):
    """A curve that is to reach a score."""

    curve: Curve
    top: float


class Measure(NamedTuple):
    """How something is measured, and on which sizes of a study it depends."""

    unit: str
    read: Callable[[Run[RunSettings]], Any]  # what one run has of it
    needs: tuple[str, ...]  # names of sizes (`qboot.study.analysis.sizes`), or `EVOLVED`
    over: Callable[[list[Any]], Summary]  # of what several runs have, at least one


def over_values(some: list[np.ndarray]) -> Summary:
    """Over the values of all runs, (n,) each."""
    values = np.concatenate(some)
    lower, median, upper = map(float, quartiles(values))
    return Summary(float(values.mean()), Quartiles(lower, median, upper), median_interval(values))


def over_climbs(some: list[Climb]) -> Summary:
    """Times at which the quartiles over runs reach the top score, as the paper has them: `statistics.times_to_goal`."""
    given = min(float(climb.curve.episodes[-1]) for climb in some)
    episodes = np.unique(np.concatenate([climb.curve.episodes for climb in some]))
    episodes = episodes[episodes <= given]
    with np.errstate(invalid="ignore"):  # before a run's first entry it has no score
        has_it = np.array([on_grid(*climb.curve, episodes) >= climb.top for climb in some])
    never = int((~has_it.any(axis=1)).sum())
    return Summary(np.nan, times_to_goal(has_it, episodes), time_interval(has_it, episodes), given, never)


def _one(value: float) -> np.ndarray:
    return np.array([value], float)


def is_evolved(run: Run[RunSettings], generations: int) -> bool:
    """Whether a run has gone on for so many generations, or reached the top score on the source set before."""
    if run.settings.evolution.generations >= generations:
        return True
    try:
        climb = _generations_to_top(run)
    except RunError:
        return False
    return bool(climb.curve.scores.max(initial=0.0) >= climb.top)


def _generations_to_top(run: Run[RunSettings]) -> Climb:
    curve = Curve(*columns(run, "history.csv", "generation", "best"))
    return Climb(curve, top_score(run, "source"))


def _source_time(run: Run[RunSettings]) -> Climb:
    return Climb(source_curve(run, "QL"), top_score(run, "source"))


def _target_time(method: str, run: Run[RunSettings]) -> Climb:
    return Climb(target_curve(run, method), top_score(run, "target"))


def _target_score(method: str, run: Run[RunSettings]) -> np.ndarray:
    """Score when Q-learning ends: its level over the last episodes, or the best of ER's population by then."""
    learned = target_curve(run, "QL")
    if method == "QL":
        return _one(moving_mean(learned, WINDOW).scores[-1])
    score = on_grid(*target_curve(run, method), learned.episodes[-1:])[0]
    # Before the first population is evaluated, ER has nothing to show.
    return _one(0.0 if np.isnan(score) else score)


def _extraction(name: str, run: Run[RunSettings]) -> np.ndarray:
    return _one(float(files.pick(read_arrays(run, "actions.npz"), name, run.file("actions.npz"))))


_EVOLVING = ("population", "generations", "n_steps")
_AFTER = ("population", EVOLVED, "n_steps")
_LEARNING = (*_AFTER, "horizon", "episodes")


def _values(unit: str, read: Callable[[Run[RunSettings]], np.ndarray], needs: tuple[str, ...]) -> Measure:
    return Measure(unit, read, needs, over_values)


def _time(unit: str, read: Callable[[Run[RunSettings]], Climb], needs: tuple[str, ...]) -> Measure:
    return Measure(unit, read, needs, over_climbs)


RUN_MEASURES = {
    "generations to the top score": _time("generations", _generations_to_top, ("population", "n_steps")),
    "best score of ER on the source set": _values(
        "score", lambda run: _one(source_curve(run, "ER").scores[-1]), _EVOLVING
    ),
    "lineage of the best-of-run": _values(
        "individuals", lambda run: _one(lineage_length(run)), ("generations", "horizon")
    ),
    "actions before clustering": _values("segments", partial(_extraction, "n_segments"), (*_EVOLVING, "horizon")),
    "duration of an action": _values(
        "steps", lambda run: np.array(read_actions(run).durations, float), (*_EVOLVING, "horizon")
    ),
    "distinct actions": _values("actions", partial(_extraction, "n_distinct"), ()),
    "inputs of the Q-networks": _values("inputs", lambda run: _one(len(read_inputs(run).sensors)), ()),
    "Q-learning episodes to the top score, source": _time("episodes", _source_time, (*_AFTER, "horizon")),
    "generalisation of ER": _values("score", lambda run: _one(generalisation(run, "ER")), _AFTER),
    "generalisation of Q-learning": _values("score", lambda run: _one(generalisation(run, "QL")), _LEARNING),
    "Q-learning episodes to the top score, target": _time("episodes", partial(_target_time, "QL"), _LEARNING),
    "ER episodes to the top score, target": _time("episodes", partial(_target_time, "ER"), ("population", "n_steps")),
    "ER+transfer episodes to the top score, target": _time("episodes", partial(_target_time, "ER+transfer"), _AFTER),
    "score of Q-learning, target": _values("score", partial(_target_score, "QL"), _LEARNING),
    "score of ER at that time, target": _values("score", partial(_target_score, "ER"), ("population", "n_steps")),
    "score of ER+transfer at that time, target": _values("score", partial(_target_score, "ER+transfer"), _AFTER),
}
