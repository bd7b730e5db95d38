"""The state of the Q-learner: selected sensors at the current and at earlier times (section IV-D)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.qlearning.settings import LearnerSettings


class InputSet(NamedTuple):
    """Inputs of the Q-networks: input i is the sensor `sensors[i]` as it was `lags[i] - 1` observations ago.

    Lag 1 is the latest observation. Inputs whose mask is false are padding and always 0.
    """

    lags: jax.Array  # (I,) int32, >= 1
    sensors: jax.Array  # (I,) int32
    mask: jax.Array  # (I,) bool


def input_set(selection: np.ndarray, n_inputs: int | None = None) -> InputSet:
    """The inputs of a selection of sensors.

    Args:
        selection: (lags, S) bool, its row 0 is lag 1.
        n_inputs: inputs to pad to; default none.

    Raises:
        ValueError: if the selection is not a matrix, is empty, or holds more than `n_inputs` inputs.
    """
    selection = np.asarray(selection, dtype=bool)
    if selection.ndim != 2:
        raise ValueError(f"selection must have the shape (lags, sensors), got {selection.shape}.")
    rows, sensors = np.nonzero(selection)
    n_inputs = len(rows) if n_inputs is None else n_inputs
    if not 0 < len(rows) <= n_inputs:
        raise ValueError(f"selection must hold between 1 and {n_inputs} inputs, got {len(rows)}.")
    padding = (0, n_inputs - len(rows))
    return InputSet(
        lags=jnp.asarray(np.pad(rows + 1, padding, constant_values=1), jnp.int32),
        sensors=jnp.asarray(np.pad(sensors, padding), jnp.int32),
        mask=jnp.arange(n_inputs) < len(rows),
    )


def first_history(observation: jax.Array, lags: int) -> jax.Array:
    """History (lags, S) at the start of a rollout: the first observation (S,), all along."""
    return jnp.broadcast_to(observation, (lags, *observation.shape))


def remember(history: jax.Array, observation: jax.Array) -> jax.Array:
    """History (lags, S) with the newest observation (S,) in front, and without the oldest."""
    return jnp.concatenate([observation[None], history[:-1]])


def read_inputs(inputs: InputSet, history: jax.Array, settings: LearnerSettings) -> jax.Array:
    """Inputs (I,) of the Q-networks, within `settings.input_range`, given the history (lags, S)."""
    low, high = settings.input_range
    sensors = history[inputs.lags - 1, inputs.sensors]
    return jnp.where(inputs.mask, low + (high - low) * sensors, 0.0)
