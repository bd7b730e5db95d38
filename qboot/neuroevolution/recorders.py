"""Recorders: what is kept of a rollout, timestep by timestep.

Only what is asked for is recorded: the rest would cost time and memory for nothing, and a rollout can be run again. The
same recorder then gives the same to the bit; another one is another program, which may round the last bit otherwise.
Shape letters: T steps, S sensors, E effectors.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from qboot.envs.task import Domain, Task, TaskState


class Timestep(NamedTuple):
    """One timestep of one rollout, as a recorder sees it."""

    state: TaskState  # before the step
    command: jax.Array  # (E,) in [0, 1], in response to the state


class Recorder(NamedTuple):
    """How a rollout is recorded; all functions are for one rollout.

    Each timestep changes a summary and gives a row of a table. Both are as they were, and the table's rows 0, once the
    rollout is over.
    """

    start: Callable[[Task], Any]  # (task) -> summary of nothing
    update: Callable[[Task, Domain, Any, Timestep], tuple[Any, Any]]  # (..., summary, timestep) -> summary, row
    finish: Callable[[Task, Domain, Any, Any, TaskState], Any]  # (..., summary, rows (T, ...), final state) -> kept


def no_summary(task: Task) -> tuple:
    """An empty summary (a `start` of recorders)."""
    return ()


def keep_rows(task: Task, domain: Domain, summary: Any, rows: Any, final: TaskState) -> Any:
    """Keep the rows (a `finish` of recorders)."""
    return rows


def _flow(task: Task, domain: Domain, summary: tuple, timestep: Timestep) -> tuple[tuple, tuple[jax.Array, jax.Array]]:
    return summary, (timestep.state.observation, timestep.command)


def _states(task: Task, domain: Domain, summary: tuple, timestep: Timestep) -> tuple[tuple, TaskState]:
    return summary, timestep.state


def _rows_and_end(
    task: Task, domain: Domain, summary: tuple, rows: TaskState, final: TaskState
) -> tuple[TaskState, TaskState]:
    return rows, final


FLOW = Recorder(no_summary, _flow, keep_rows)
"""The sensori-motor flow of a rollout, a learning trace (section IV-A): observations (T, S) and commands (T, E)."""

STATES = Recorder(no_summary, _states, _rows_and_end)
"""Every state of a rollout (T, ...), and the final one."""
