"""The robotic arm of box pushing: a box-shaped hand on three sliders that keep no velocity.

Every step starts with the sliders at rest, so a command moves the hand in proportion and at once: a force of
500 (2u - 1) N for one step of 0.01 s on masses of 2, 3 and 4 kg (x carries the hand, y carries x, z carries
y). This gives the recorded steps of -0.05, -0.0333 and -0.025 metres times (u - 0.5). Lengths are in metres;
x and y span the table, z points up. A command above 0.5 moves towards minus.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

TIME_STEP = 0.01  # s
FORCE = 500.0  # N at full command
HALF_SIZE = np.array([0.04, 0.05, 0.02], np.float32)  # of the hand
MOVED_MASS = np.array([2.0, 3.0, 4.0], np.float32)  # kg, what the x, y and z slider set in motion
STOP_LOW = np.array([0.1, -0.34, 0.722], np.float32)  # measured in the recorded runs
STOP_HIGH = np.array([0.6, 0.11, 0.822], np.float32)
STEP_PER_COMMAND = -2.0 * FORCE * TIME_STEP**2 / MOVED_MASS
LONGEST_STEP = 0.5 * np.abs(STEP_PER_COMMAND)
REACH_LOW = STOP_LOW - LONGEST_STEP  # a stop is overshot by one step at most
REACH_HIGH = STOP_HIGH + LONGEST_STEP


class Motion(NamedTuple):
    """What one step of either physics does."""

    hand: jax.Array  # (3,) centre after the step
    block: jax.Array  # (3,) centre after the step
    touching: jax.Array  # () bool, hand and block overlapped at the start of the step
    normal: jax.Array  # (3,) unit vector from the block to the hand; meaningful only when touching


def admissible(hand: jax.Array, command: jax.Array) -> jax.Array:
    """`command` (..., 3) in [0, 1], neutral where it pushes a slider outwards that is past its stop."""
    outwards = ((hand > STOP_HIGH) & (command < 0.5)) | ((hand < STOP_LOW) & (command > 0.5))
    return jnp.where(outwards, 0.5, command)
