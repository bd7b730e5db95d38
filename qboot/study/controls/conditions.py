"""The control experiments of section VII as tables: which conditions there are, and what each learns with.

A *cell* is one Q-learner of one condition. It starts from one evolved run of the study, whose domains it learns in
and whose extracted actions or sensors it may use. Adding a condition is adding a row.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from qboot.envs.task import Expert, Task
from qboot.extraction import baselines
from qboot.extraction.actions import ActionSet, cluster_actions
from qboot.extraction.segmentation import Segments
from qboot.study.pipeline.profiles import defaults_of
from qboot.study.store.artifacts import read_actions, read_selection, task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings, RunSettings

# The random setup draws from 12 past time steps: 1 to 156 inputs of 13 sensors (section VII-B).
LAGS = 12

WHATS = ("actions", "sensors", "n_actions")


class Evolved(NamedTuple):
    """The evolved run that a cell starts from."""

    run: Run[RunSettings]
    segments: Callable[[], Segments]  # of its traces, which are played again when they are asked for


class Condition(NamedTuple):
    """What a cell learns with, given its settings and its evolved run."""

    meaning: str
    actions: Callable[[CellSettings, Evolved], ActionSet]
    sensors: Callable[[CellSettings, Evolved], np.ndarray]  # (lags, S) bool


class Place(NamedTuple):
    """Where a condition is at home: the first experiment that has it, and its name there."""

    what: str
    condition: str


def conditions(task: Task, what: str) -> dict[str, Condition]:
    """The conditions of an experiment by name, in the paper's order.

    Those with what a human designed are there for tasks that have an `expert`. Without one, the others learn with
    what was extracted: all of a control experiment differs in one thing alone.

    Raises:
        ValueError: for an unknown experiment.
    """
    found = _tables(task)
    if what not in found:
        raise ValueError(f"unknown experiment {what!r}: choose one of {', '.join(found)}")
    return found[what]


def places(task: Task, what: str) -> dict[str, Place]:
    """Where each condition of an experiment is at home.

    Experiments have conditions in common: what a human designed, all of it, stands in two of them, and so do the
    extracted actions in their own number. The same learners serve both.
    """
    tables = _tables(task)
    homes: dict[tuple[Callable, Callable], Place] = {}
    for each, table in tables.items():
        for name, condition in table.items():
            homes.setdefault((condition.actions, condition.sensors), Place(each, name))
    return {name: homes[condition.actions, condition.sensors] for name, condition in tables[what].items()}


def is_shared(task: Task, place: Place) -> bool:
    """Whether several experiments have the condition that is at home there."""
    return sum(place in places(task, what).values() for what in WHATS) > 1


def _tables(task: Task) -> dict[str, dict[str, Condition]]:
    expert = task.expert
    sensors = human_sensors(expert, task) if expert else selected_sensors
    actions = human_actions(expert) if expert else extracted_actions
    defaults = defaults_of(task)
    tables: dict[str, dict[str, Condition | None]] = {
        "actions": {
            "extracted": Condition("extracted from the traces of an evolved run", extracted_actions, sensors),
            "human": Condition("designed by hand", actions, sensors) if expert else None,
            "random": Condition("drawn at random", random_actions, sensors),
        },
        "sensors": {
            "instant": Condition("all sensors, no past", actions, instant_sensors),
            "human": Condition("chosen by hand", actions, sensors) if expert else None,
            "selected": Condition("automatic selection by the lasso", actions, selected_sensors),
            "random": Condition("drawn from 12 past steps, any number", actions, random_sensors),
            "random+": Condition("drawn at random, as many as selected", actions, as_many_random_sensors),
        },
        "n_actions": {
            str(n): Condition(
                f"{n} extracted actions",
                extracted_actions if n == defaults.actions.n_actions else in_clusters(n),
                sensors,
            )
            for n in defaults.n_actions
        },
    }
    return {
        what: {name: condition for name, condition in table.items() if condition is not None}
        for what, table in tables.items()
    }


def human_actions(expert: Expert) -> Callable[[CellSettings, Evolved], ActionSet]:
    """The actions that an expert designed."""
    return lambda cell, evolved: expert.actions()


def extracted_actions(cell: CellSettings, evolved: Evolved) -> ActionSet:
    """The evolved run's actions."""
    return read_actions(evolved.run)


def random_actions(cell: CellSettings, evolved: Evolved) -> ActionSet:
    """As many actions as are extracted, drawn at random."""
    task = task_of(evolved.run)
    durations = defaults_of(task).random_durations
    return baselines.random_actions(cell.seed, cell.actions.n_actions, len(task.effectors), durations)


def in_clusters(n: int) -> Callable[[CellSettings, Evolved], ActionSet]:
    """The evolved run's segments in `n` clusters."""
    return lambda cell, evolved: cluster_actions(
        evolved.segments(), replace(cell.actions, n_actions=n), evolved.run.settings.seed
    )[0]


def instant_sensors(cell: CellSettings, evolved: Evolved) -> np.ndarray:
    """All sensors, as they are now."""
    return np.ones((1, len(task_of(evolved.run).sensors)), bool)


def human_sensors(expert: Expert, task: Task) -> Callable[[CellSettings, Evolved], np.ndarray]:
    """The inputs that an expert chose."""
    return lambda cell, evolved: baselines.chosen_sensors(expert.sensors, task.sensors)


def selected_sensors(cell: CellSettings, evolved: Evolved) -> np.ndarray:
    """The inputs that were selected from the evolved run's traces."""
    return read_selection(evolved.run)


def random_sensors(cell: CellSettings, evolved: Evolved) -> np.ndarray:
    """Any number of inputs of 12 past steps."""
    return baselines.random_sensors(cell.seed, LAGS, len(task_of(evolved.run).sensors))


def as_many_random_sensors(cell: CellSettings, evolved: Evolved) -> np.ndarray:
    """Random inputs, as many as were selected."""
    n_inputs = int(selected_sensors(cell, evolved).sum())
    return baselines.random_sensors(cell.seed, LAGS, len(task_of(evolved.run).sensors), n_inputs)
