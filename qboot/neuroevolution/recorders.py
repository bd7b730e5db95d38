"""Recorders: what is kept of a rollout, folded timestep by timestep into a record of fixed size.

Only what is asked for is recorded: the rest would cost time and memory for nothing, and a rollout can be run again, to
the bit. Shape letters: T steps, S sensors, E effectors.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from qboot.envs.task import Domain, Task, TaskState


class Timestep(NamedTuple):
    """One timestep of one rollout, as a recorder sees it."""

    t: jax.Array  # () int32
    alive: jax.Array  # () bool, false once the rollout is over: nothing more is to be recorded
    state: TaskState  # before the step
    command: jax.Array  # (E,) in [0, 1], in response to the state


class Recorder(NamedTuple):
    """How a rollout is recorded; all functions are for one rollout."""

    start: Callable[[Task, int], Any]  # (task, n_steps) -> empty record
    update: Callable[[Task, Domain, Any, Timestep], Any]  # -> record with one more timestep
    finish: Callable[[Task, Domain, Any, TaskState], Any]  # (..., record, final state) -> what is kept


def as_it_is(task: Task, domain: Domain, record: Any, final: TaskState) -> Any:
    """Keep the record (a `finish` of recorders)."""
    return record


def write(buffer: jax.Array, index: jax.Array, value: jax.Array, alive: jax.Array) -> jax.Array:
    """`buffer` (T, ...) with `value` (...) at `index`, or as it was when not `alive`."""
    return buffer.at[index].set(jnp.where(alive, value.astype(buffer.dtype), buffer[index]))


def _start_flow(task: Task, n_steps: int) -> tuple[jax.Array, jax.Array]:
    return jnp.zeros((n_steps, len(task.sensors))), jnp.zeros((n_steps, len(task.effectors)))


def _update_flow(task: Task, domain: Domain, record: tuple, timestep: Timestep) -> tuple[jax.Array, jax.Array]:
    observations, commands = record
    return (
        write(observations, timestep.t, timestep.state.observation, timestep.alive),
        write(commands, timestep.t, timestep.command, timestep.alive),
    )


def _start_states(task: Task, n_steps: int) -> TaskState:
    domain = jax.tree.map(lambda leaf: leaf[0], task.source_domains(task.sources[0]))
    state = jax.eval_shape(task.reset, jax.random.key(0), domain)
    return jax.tree.map(lambda leaf: jnp.zeros((n_steps, *leaf.shape), leaf.dtype), state)


def _update_states(task: Task, domain: Domain, record: TaskState, timestep: Timestep) -> TaskState:
    return jax.tree.map(lambda buffer, value: write(buffer, timestep.t, value, timestep.alive), record, timestep.state)


def _finish_states(task: Task, domain: Domain, record: TaskState, final: TaskState) -> tuple[TaskState, TaskState]:
    return record, final


FLOW = Recorder(_start_flow, _update_flow, as_it_is)
"""The sensori-motor flow of a rollout, a learning trace (section IV-A): observations (T, S) and commands (T, E)."""

STATES = Recorder(_start_states, _update_states, _finish_states)
"""Every state of a rollout (T, ...), and the final one."""
