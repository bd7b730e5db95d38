"""What is kept of a test to compare behaviours (paper, sections V-A2 and VI-A2).

A `Recorder` keeps a small record at every step and turns the records of a test into a description. Only the distance
in force is recorded: the others would cost time and memory for nothing, and a test can be run again, to the bit.
Shape letters: T steps, S sensors, E effectors.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from qboot.envs.types import Domain, Task, TaskState

ENTROPY_BINS = 9  # appendix B, entropy discretization


class Recorder(NamedTuple):
    """How one behaviour is recorded; all functions are for one test."""

    # (task, domain, state, command) -> record of the step, or None
    record: Callable[[Task, Domain, TaskState, jax.Array], jax.Array | None]
    # (task, domain, records (T, ...), steps () lived, final state) -> description
    describe: Callable[[Task, Domain, jax.Array | None, jax.Array, TaskState], jax.Array]


def _channels(state: TaskState, command: jax.Array) -> jax.Array:
    return jnp.concatenate([state.observation, command])


def _record_bits(task: Task, domain: Domain, state: TaskState, command: jax.Array) -> jax.Array:
    on = _channels(state, command) >= 0.5
    return jnp.sum(on * (1 << jnp.arange(on.shape[0])), dtype=jnp.int32).astype(jnp.uint16)


def _describe_bits(task: Task, domain: Domain, records: jax.Array, steps: jax.Array, final: TaskState) -> jax.Array:
    return jnp.where(jnp.arange(records.shape[0]) < steps, records, 0)


def _record_bins(task: Task, domain: Domain, state: TaskState, command: jax.Array) -> jax.Array:
    bins = (_channels(state, command) * ENTROPY_BINS).astype(jnp.int32)
    return jnp.clip(bins, 0, ENTROPY_BINS - 1).astype(jnp.uint8)


def _describe_bins(task: Task, domain: Domain, records: jax.Array, steps: jax.Array, final: TaskState) -> jax.Array:
    lived = jnp.arange(records.shape[0]) < steps
    hits = [jnp.sum((records == value) & lived[:, None], axis=0) for value in range(ENTROPY_BINS)]
    return jnp.stack(hits, axis=-1).astype(jnp.int32)


def _record_cell(task: Task, domain: Domain, state: TaskState, command: jax.Array) -> jax.Array:
    return task.position(domain, state).astype(jnp.int16)


def _describe_cells(task: Task, domain: Domain, records: jax.Array, steps: jax.Array, final: TaskState) -> jax.Array:
    lived = jnp.arange(records.shape[0]) < steps
    return jnp.where(lived, records, -1)[:: task.trajectory_period]


def _record_nothing(task: Task, domain: Domain, state: TaskState, command: jax.Array) -> None:
    return None


def _describe_outcome(task: Task, domain: Domain, records: None, steps: jax.Array, final: TaskState) -> jax.Array:
    return task.outcome(domain, final)


RECORDERS = {
    # (T,) uint16: sensors and effectors binarised at half range, a bit each; 0 once the test is over
    "hamming": Recorder(_record_bits, _describe_bits),
    # (S + E, 9) int32: how often each channel was in each of nine bins
    "entropy": Recorder(_record_bins, _describe_bins),
    # (T / trajectory_period,) int16: cells of the discretised trajectory; -1 once the test is over
    "trajectory": Recorder(_record_cell, _describe_cells),
    # (k,) float32: the task's own outcome, for instance where the balls are in the end
    "adhoc": Recorder(_record_nothing, _describe_outcome),
}
