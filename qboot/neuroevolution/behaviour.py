"""What is kept of a test to compare behaviours (paper, sections V-A2 and VI-A2).

A `Recorder` folds a test, step by step, into a description of fixed size. Only the distance in force is recorded: the
others would cost time and memory for nothing, and a test can be run again, to the bit.
Shape letters: T steps, S sensors, E effectors.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from qboot.envs.task import Domain, Task, TaskState

ENTROPY_BINS = 9  # appendix B, entropy discretization


class Moment(NamedTuple):
    """One step of one test, as a recorder sees it."""

    t: jax.Array  # () int32
    alive: jax.Array  # () bool, false once the test is over: nothing more is to be recorded
    state: TaskState  # before the step
    command: jax.Array  # (E,) in [0, 1], in response to the state


class Recorder(NamedTuple):
    """How one behaviour is recorded; all functions are for one test."""

    start: Callable[[Task, int], Any]  # (task, n_steps) -> empty record
    update: Callable[[Task, Domain, Any, Moment], Any]  # -> record with one more step
    finish: Callable[[Task, Domain, Any, TaskState], Any]  # (..., record, final state) -> description


def _as_it_is(task: Task, domain: Domain, record: Any, final: TaskState) -> Any:
    return record


def _write(buffer: jax.Array, index: jax.Array, value: jax.Array, alive: jax.Array) -> jax.Array:
    return buffer.at[index].set(jnp.where(alive, value.astype(buffer.dtype), buffer[index]))


def _n_channels(task: Task) -> int:
    return len(task.sensors) + len(task.effectors)


def _channels(moment: Moment) -> jax.Array:
    return jnp.concatenate([moment.state.observation, moment.command])


def _start_bits(task: Task, n_steps: int) -> jax.Array:
    return jnp.zeros(n_steps, jnp.uint16)


def _update_bits(task: Task, domain: Domain, record: jax.Array, moment: Moment) -> jax.Array:
    on = _channels(moment) >= 0.5
    return _write(record, moment.t, jnp.sum(on * (1 << jnp.arange(on.shape[0])), dtype=jnp.int32), moment.alive)


def _start_counts(task: Task, n_steps: int) -> jax.Array:
    return jnp.zeros((_n_channels(task), ENTROPY_BINS), jnp.int32)


def _update_counts(task: Task, domain: Domain, record: jax.Array, moment: Moment) -> jax.Array:
    bins = jnp.clip((_channels(moment) * ENTROPY_BINS).astype(jnp.int32), 0, ENTROPY_BINS - 1)
    return record + ((bins[:, None] == jnp.arange(ENTROPY_BINS)) & moment.alive)


def _start_cells(task: Task, n_steps: int) -> jax.Array:
    return jnp.full(-(-n_steps // task.trajectory_period), -1, jnp.int16)


def _update_cells(task: Task, domain: Domain, record: jax.Array, moment: Moment) -> jax.Array:
    sampled = moment.alive & (moment.t % task.trajectory_period == 0)
    return _write(record, moment.t // task.trajectory_period, task.position(domain, moment.state), sampled)


def _start_nothing(task: Task, n_steps: int) -> tuple:
    return ()


def _update_nothing(task: Task, domain: Domain, record: tuple, moment: Moment) -> tuple:
    return record


def _finish_outcome(task: Task, domain: Domain, record: tuple, final: TaskState) -> jax.Array:
    return task.outcome(domain, final)


def _start_flow(task: Task, n_steps: int) -> tuple[jax.Array, jax.Array]:
    return jnp.zeros((n_steps, len(task.sensors))), jnp.zeros((n_steps, len(task.effectors)))


def _update_flow(task: Task, domain: Domain, record: tuple, moment: Moment) -> tuple[jax.Array, jax.Array]:
    observations, commands = record
    return (
        _write(observations, moment.t, moment.state.observation, moment.alive),
        _write(commands, moment.t, moment.command, moment.alive),
    )


def _start_states(task: Task, n_steps: int) -> TaskState:
    domain = jax.tree.map(lambda leaf: leaf[0], task.source_domains(task.sources[0]))
    state = jax.eval_shape(task.reset, jax.random.key(0), domain)
    return jax.tree.map(lambda leaf: jnp.zeros((n_steps, *leaf.shape), leaf.dtype), state)


def _update_states(task: Task, domain: Domain, record: TaskState, moment: Moment) -> TaskState:
    return jax.tree.map(lambda buffer, value: _write(buffer, moment.t, value, moment.alive), record, moment.state)


def _finish_states(task: Task, domain: Domain, record: TaskState, final: TaskState) -> tuple[TaskState, TaskState]:
    return record, final


RECORDERS = {
    # (T,) uint16: sensors and effectors binarised at half range, a bit each; 0 once the test is over
    "hamming": Recorder(_start_bits, _update_bits, _as_it_is),
    # (S + E, 9) int32: how often each channel was in each of nine bins
    "entropy": Recorder(_start_counts, _update_counts, _as_it_is),
    # (T / trajectory_period,) int16: cells of the discretised trajectory; -1 once the test is over
    "trajectory": Recorder(_start_cells, _update_cells, _as_it_is),
    # (k,) float32: the task's own outcome, for instance where the balls are in the end
    "adhoc": Recorder(_start_nothing, _update_nothing, _finish_outcome),
}

# The whole sensori-motor flow: observations (T, S) and commands (T, E)
FLOW = Recorder(_start_flow, _update_flow, _as_it_is)

# Every state of a test (T, ...), and the final one
STATES = Recorder(_start_states, _update_states, _finish_states)
