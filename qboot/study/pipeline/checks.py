"""Settings that cannot work, found out before anything is written."""

import dataclasses
import math
import os
from collections.abc import Iterator
from typing import Any

import jax

from qboot.envs.registry import get_task
from qboot.envs.task import Task
from qboot.neuroevolution.evaluation import BLOCK
from qboot.study.store.settings import RunSettings

LARGEST = 2**31 - 1  # of whole numbers in compiled programs
GIB = 2**30


def check(settings: RunSettings) -> None:
    """Refuse settings with which some stage of a run is bound to fail.

    Raises:
        ValueError: says which setting, and what it may be.
    """
    task = get_task(settings.task, settings.physics)
    if settings.source not in task.sources:
        raise ValueError(f"unknown source {settings.source!r} of {task.name}: choose one of {', '.join(task.sources)}")
    for name, value in _numbers(dataclasses.asdict(settings)):
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value}: it must be a finite number")
        if isinstance(value, int) and value > LARGEST and name != "seed":
            raise ValueError(f"{name} is {value}: it must be at most {LARGEST}")
    _check_networks(settings, task)
    _check_lags(settings)
    _check_actions(settings, task)
    _check_sizes(settings, task)


def _check_networks(settings: RunSettings, task: Task) -> None:
    for name, parts in (("n_inputs", task.sensors), ("n_outputs", task.effectors)):
        given, kind = getattr(settings.dnn, name), "sensors" if name == "n_inputs" else "effectors"
        if given != len(parts):
            raise ValueError(f"dnn.{name} is {given}: {task.name} has {len(parts)} {kind}, so it must be {len(parts)}")


def _check_lags(settings: RunSettings) -> None:
    if settings.sensors.lags > settings.learner.lags:
        raise ValueError(
            f"sensors.lags is {settings.sensors.lags}: the learner remembers no more than learner.lags, which is "
            f"{settings.learner.lags}"
        )
    if settings.n_steps <= settings.sensors.lags:
        raise ValueError(
            f"n_steps is {settings.n_steps}: sensors are selected from more than sensors.lags steps, which are "
            f"{settings.sensors.lags}"
        )


def _check_actions(settings: RunSettings, task: Task) -> None:
    """Every action needs a segment."""
    per_rollout = max(1, settings.n_steps // settings.actions.min_duration)
    # Long segments are cut before they are clustered.
    per_rollout = max(per_rollout, -(-settings.n_steps // settings.actions.max_duration))
    most = _policies(settings) * _rollouts(settings, task) * per_rollout
    if settings.actions.n_actions > most:
        raise ValueError(
            f"actions.n_actions is {settings.actions.n_actions}: each needs a segment of the traces, and "
            f"{_policies(settings)} policies in {_rollouts(settings, task)} rollouts of {settings.n_steps} steps "
            f"have {most} at most"
        )


def _check_sizes(settings: RunSettings, task: Task) -> None:
    evolution = settings.evolution
    generations = max(evolution.generations, settings.target_generations)
    if (newborn := evolution.population * (generations + 2)) >= 2**32:
        raise ValueError(
            f"evolution.population of {evolution.population} for {generations} generations makes {newborn} "
            f"individuals: {2**32 - 1} can be told apart"
        )
    name, needed = max(_memory(settings, task).items(), key=lambda item: item[1])
    available = _physical_memory()
    if needed > available:
        raise ValueError(
            f"{name} is too large: about {needed / GIB:,.0f} GiB of memory are needed, this machine has "
            f"{available / GIB:,.0f}"
        )


def _memory(settings: RunSettings, task: Task) -> dict[str, float]:
    """The largest arrays in bytes, roughly, by the setting that most decides their size."""
    n_sensors, n_effectors, steps = len(task.sensors), len(task.effectors), settings.n_steps
    population, rollouts = settings.evolution.population, _rollouts(settings, task)
    dnn, learner, sensors = settings.dnn, settings.learner, settings.sensors
    genome = 13 * dnn.max_connections + 5 * dnn.n_computing
    lanes = min(BLOCK, 2 * population) * rollouts
    n_inputs = sensors.lags * n_sensors
    return {
        "evolution.population": 3.0 * population * genome
        + (2.0 * population) ** 2
        + 8.0 * population * rollouts * (steps // task.trajectory_period),
        "evolution.horizon": 4.0 * _policies(settings) * (genome + rollouts * steps * (n_sensors + n_effectors)),
        "n_steps": 4.0 * lanes * steps * (n_sensors + n_effectors),
        "dnn.max_hidden": 4.0 * lanes * dnn.n_computing * dnn.n_neurons,
        "dnn.max_connections": 13.0 * lanes * dnn.max_connections,
        "learner.hidden": 4.0 * settings.actions.n_actions * learner.hidden * (n_inputs + 3),
        "learner.eta": 4.0 * rollouts * learner.eta * -(-steps // settings.actions.min_duration) * (n_inputs + 4),
        "learner.lags": 4.0 * learner.lags * n_sensors,
        "sensors.lags": 8.0 * ((sensors.lags + 1) * n_sensors + 1) ** 2,
    }


def _policies(settings: RunSettings) -> int:
    """Of a lineage at most."""
    return min(settings.evolution.horizon, settings.evolution.generations + 1)


def _rollouts(settings: RunSettings, task: Task) -> int:
    """Of an episode on the source set."""
    return len(jax.tree.leaves(task.source_domains(settings.source))[0]) * task.rollouts_per_domain


def _physical_memory() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # not said on this system
        return math.inf


def _numbers(values: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """All numbers in nested settings by their names on the command line."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from _numbers(value, f"{name}.{key}" if name else key)
    elif isinstance(values, tuple | list):
        for value in values:
            yield from _numbers(value, name)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield name, values
