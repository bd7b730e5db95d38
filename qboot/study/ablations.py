"""The control experiments of section VII as tables: which conditions there are, and what each learns with.

A *cell* is one Q-learner of one condition. It starts from one evolved run of the study, whose domains it learns in
and whose extracted actions or sensors it may use. Adding a condition is adding a row.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.envs import TASKS, expert_ball_collecting, expert_box_pushing
from qboot.extraction import baselines
from qboot.extraction.actions import ActionSet, ActionSettings, cluster_actions
from qboot.extraction.segmentation import Segments
from qboot.qlearning.settings import LearnerSettings
from qboot.study import files, runs, stages
from qboot.study.files import RunError
from qboot.study.runs import Run

# What experts designed for each task.
EXPERTS = {"ball_collecting": expert_ball_collecting, "box_pushing": expert_box_pushing}
# The random setup draws from 12 past time steps: 1 to 156 inputs of 13 sensors (section VII-B).
LAGS = 12
# Na of section VII-C. The paper plots a range without saying which.
SWEPT_N_ACTIONS = {"ball_collecting": (4, 8, 17, 30, 50), "box_pushing": (3, 5, 7, 15, 30)}


@dataclass(frozen=True)
class CellSettings:
    """Every setting of a cell. Those that a run has too mean the same."""

    task: str
    source: str
    physics: str
    seed: int
    """Which cell of its condition: everything random comes from it and from the condition's name."""
    profile: str
    n_steps: int
    what: str
    """Which experiment: actions, sensors or n_actions."""
    condition: str
    """Row of the experiment's table."""
    evolved: str
    """Folder name of the evolved run."""
    actions: ActionSettings
    """How actions are clustered where they are extracted; their number in any case."""
    learner: LearnerSettings
    episodes: int
    lanes: int
    """Learners that one program runs side by side. Other widths are rounded differently, in the last bits."""


class Condition(NamedTuple):
    """What a cell learns with, given its settings and its evolved run."""

    meaning: str
    actions: Callable[[CellSettings, Run], ActionSet]
    sensors: Callable[[CellSettings, Run], np.ndarray]  # (lags, S) bool


def human_actions(cell: CellSettings, evolved: Run) -> ActionSet:
    """The actions that an expert designed."""
    return EXPERTS[cell.task].actions()


def extracted_actions(cell: CellSettings, evolved: Run) -> ActionSet:
    """The evolved run's actions."""
    return stages.read_actions(evolved)


def random_actions(cell: CellSettings, evolved: Run) -> ActionSet:
    """As many actions as are extracted, drawn at random."""
    n_effectors = len(TASKS[cell.task].effectors)
    durations = EXPERTS[cell.task].RANDOM_DURATIONS
    return baselines.random_actions(cell.seed, cell.actions.n_actions, n_effectors, durations)


def clustered_actions(cell: CellSettings, evolved: Run) -> ActionSet:
    """The evolved run's segments in another number of clusters."""
    return cluster_actions(_segments(evolved), cell.actions, evolved.settings.seed)[0]


def instant_sensors(cell: CellSettings, evolved: Run) -> np.ndarray:
    """All sensors, as they are now."""
    return np.ones((1, len(TASKS[cell.task].sensors)), bool)


def human_sensors(cell: CellSettings, evolved: Run) -> np.ndarray:
    """The inputs that an expert chose."""
    return baselines.named_sensors(TASKS[cell.task].sensors, EXPERTS[cell.task].SENSORS)


def selected_sensors(cell: CellSettings, evolved: Run) -> np.ndarray:
    """The inputs that the lasso selected from the evolved run's traces."""
    return stages.read_selection(evolved)


def random_sensors(cell: CellSettings, evolved: Run) -> np.ndarray:
    """From 1 to 156 inputs of 12 past steps."""
    return baselines.random_sensors(cell.seed, LAGS, len(TASKS[cell.task].sensors))


def as_many_random_sensors(cell: CellSettings, evolved: Run) -> np.ndarray:
    """Random inputs, as many as the lasso selected."""
    n_inputs = int(selected_sensors(cell, evolved).sum())
    return baselines.random_sensors(cell.seed, LAGS, len(TASKS[cell.task].sensors), n_inputs)


ACTIONS = {
    "extracted": Condition("extracted from the traces of an evolved run", extracted_actions, human_sensors),
    "human": Condition("designed by hand", human_actions, human_sensors),
    "random": Condition("drawn at random", random_actions, human_sensors),
}
SENSORS = {
    "instant": Condition("all sensors, no past", human_actions, instant_sensors),
    "human": Condition("chosen by hand", human_actions, human_sensors),
    "selected": Condition("automatic selection by the lasso", human_actions, selected_sensors),
    "random": Condition("1 to 156 drawn from 12 past steps", human_actions, random_sensors),
    "random+": Condition("drawn at random, as many as selected", human_actions, as_many_random_sensors),
}
WHATS = ("actions", "sensors", "n_actions")


def conditions(task: str, what: str) -> dict[str, Condition]:
    """The conditions of an experiment by name, in the paper's order.

    Raises:
        ValueError: for an unknown task or experiment.
    """
    if task not in TASKS:
        raise ValueError(f"unknown task {task!r}: choose one of {', '.join(TASKS)}")
    numbers = SWEPT_N_ACTIONS[task]
    tables = {
        "actions": ACTIONS,
        "sensors": SENSORS,
        "n_actions": {str(n): Condition(f"{n} extracted actions", clustered_actions, human_sensors) for n in numbers},
    }
    if what not in tables:
        raise ValueError(f"unknown experiment {what!r}: choose one of {', '.join(tables)}")
    return tables[what]


def begin(study: Path, task: str, what: str, profile: str, n_runs: int, n_episodes: int, lanes: int) -> dict[Run, Run]:
    """The cells of an experiment, begun now or earlier, and the evolved run of each.

    Args:
        study: folder of the study, with finished runs of the task.
        task: name of the task.
        what: the experiment.
        profile: name of the profile, to be kept with the cells.
        n_runs: cells per condition, >= 1.
        n_episodes: of Q-learning, >= 1.
        lanes: learners side by side in a program, >= 1.

    Raises:
        ValueError: for an unknown task or experiment, or a number below 1.
        RunError: if no run of the task has extracted actions and sensors, or a cell was begun with other settings.
    """
    for name, value in (("runs", n_runs), ("episodes", n_episodes), ("lanes", lanes)):
        if value < 1:
            raise ValueError(f"{name} is {value}: at least 1 is needed")
    names = conditions(task, what)
    evolved = _evolved(study, task)
    cells = {}
    for condition in names:
        for seed in range(n_runs):
            folder = folder_of(study, task, what) / condition / str(seed)
            # A cell stays with its evolved run when there are more of them later.
            known = runs.load(folder, CellSettings).settings.evolved if (folder / "config.json").exists() else None
            by_name = {run.folder.name: run for run in evolved}
            if known is not None and known not in by_name:
                raise RunError(f"{folder} was begun from the run {known}, which is gone: make it again, or delete both")
            run = by_name[known] if known else evolved[seed % len(evolved)]
            settings = CellSettings(
                task=task,
                source=run.settings.source,
                physics=run.settings.physics,
                seed=seed,
                profile=profile,
                n_steps=run.settings.n_steps,
                what=what,
                condition=condition,
                evolved=run.folder.name,
                actions=replace(run.settings.actions, n_actions=int(condition))
                if what == "n_actions"
                else run.settings.actions,
                learner=run.settings.learner,
                episodes=n_episodes,
                lanes=lanes,
            )
            cells[runs.create(folder, settings)] = run
    return cells


def find(study: Path, task: str, what: str) -> dict[str, list[Run]]:
    """The finished cells of an experiment by condition; conditions without any are left out."""
    found = {}
    for condition in conditions(task, what):
        folders = (folder_of(study, task, what) / condition).glob("*/qlearning.csv")
        by_seed = sorted(folders, key=lambda path: int(path.parent.name))
        if by_seed:
            found[condition] = [runs.load(path.parent, CellSettings) for path in by_seed]
    return found


def equip(cell: Run, evolved: Run) -> None:
    """Write what a cell learns with: actions.npz and sensors.npz, as the stage extract does for a run."""
    if cell.file("sensors.npz").exists():
        return
    condition = conditions(cell.settings.task, cell.settings.what)[cell.settings.condition]
    files.write_npz(cell.file("actions.npz"), files.to_arrays(condition.actions(cell.settings, evolved)))
    files.write_npz(cell.file("sensors.npz"), {"selected": condition.sensors(cell.settings, evolved)})


def folder_of(study: Path, task: str, what: str) -> Path:
    """Where the cells of an experiment are, CONDITION/SEED below it."""
    return study / "ablations" / task / what


def _evolved(study: Path, task: str) -> list[Run]:
    """Runs that actions and sensors were extracted from, the sources in turn."""
    ready = [run for run in runs.find(study) if run.settings.task == task and run.file("sensors.npz").exists()]
    if not ready:
        raise RunError(
            f"{study} has no run of {task} with extracted actions and sensors: "
            "make some with `qboot reproduce`, or with `qboot evolve` and `qboot extract`"
        )
    return sorted(ready, key=lambda run: (run.settings.seed, run.settings.source))


@functools.lru_cache(maxsize=1)
def _segments(evolved: Run) -> Segments:
    return stages.segments_of(evolved, stages.replayed(evolved, workers=1))
