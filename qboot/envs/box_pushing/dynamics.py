"""The dynamics of box pushing (paper, section VI): a robotic arm pushes a block to the left, towards minus y.

A rollout ends at the first contact between hand and block. It succeeds when the hand touches the block's right
face, centred. As in the recorded original, the contact is seen in the step after the one that made hand and
block overlap; in that step the block shifts. Lengths are in metres.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.box_pushing import arm, domains
from qboot.envs.box_pushing.domains import Block

SENSORS = (
    "hand_x", "hand_y", "hand_z",
    "hand_low_x_to_block_high_x", "hand_high_x_to_block_low_x",
    "hand_low_y_to_block_high_y", "hand_high_y_to_block_low_y",
    "hand_bottom_to_block_top",
    "table_low_x_to_block", "table_low_y_to_block", "block_to_table_high_y",
    "hand_x_from_block", "hand_y_from_block",
)  # fmt: skip
EFFECTORS = ("x", "y", "z")

# The range of each sensor, scaled to [0, 1] and clipped.
SENSOR_LOW = np.array([0.076, -0.35, 0.7145, 0, 0, 0, 0, 0, 0, 0, 0, -0.46, -0.54], np.float32)
SENSOR_HIGH = np.array([0.62, 0.11, 0.827, 0.48, 0.44, 0.48, 0.55, 0.07, 0.67, 0.71, 0.93, 0.68, 0.56], np.float32)
REWARD = 10.0
NORMAL_ALIGNMENT = 0.98  # at least this much of the contact normal points along +y
CENTRING = 0.02  # m, largest distance in x and z between the centres
GRID = np.array([6, 6, 4], np.int32)  # cells of the discretised trajectory over the hand's reach: 9 x 8 x 3 cm each


class PushState(NamedTuple):
    """State of one rollout; the first three fields are those of every task."""

    observation: jax.Array  # (13,) in [0, 1], in the order of SENSORS
    reward: jax.Array  # () 10 when the block was just shifted to the left (equation 8)
    done: jax.Array  # () bool, hand and block have touched
    hand: jax.Array  # (3,) centre
    block: jax.Array  # (3,) centre
    travelled: jax.Array  # (6,) path lengths of hand and block along x, y, z


def observe(domain: Block, hand: jax.Array, block: jax.Array) -> jax.Array:
    """The 13 sensors in [0, 1], in the order of SENSORS, from the centres of hand (3,) and block (3,)."""
    hand_low, hand_high = hand - arm.HALF_SIZE, hand + arm.HALF_SIZE
    block_low, block_high = block - domain.half_size, block + domain.half_size
    raw = jnp.stack(
        [
            hand[0], hand[1], hand[2],
            jnp.abs(hand_low[0] - block_high[0]), jnp.abs(hand_high[0] - block_low[0]),
            jnp.abs(hand_low[1] - block_high[1]), jnp.abs(hand_high[1] - block_low[1]),
            jnp.abs(hand_low[2] - block_high[2]),
            block_low[0] - domains.TABLE_LOW[0], block_low[1] - domains.TABLE_LOW[1],
            domains.TABLE_HIGH[1] - block_high[1],
            hand[0] - block[0], hand[1] - block[1],
        ]
    )  # fmt: skip
    return jnp.clip((raw - SENSOR_LOW) / (SENSOR_HIGH - SENSOR_LOW), 0.0, 1.0)


def state_at(domain: Block, hand: jax.Array, block: jax.Array) -> PushState:
    """The state of a rollout that starts with centres `hand` (3,) and `block` (3,)."""
    return PushState(
        observation=observe(domain, hand, block),
        reward=jnp.float32(0.0),
        done=jnp.array(False),
        hand=hand,
        block=block,
        travelled=jnp.zeros(6, jnp.float32),
    )


def reset(key: jax.Array, domain: Block) -> PushState:
    """State at the start of a rollout: random places of hand and block that do not touch."""
    return state_at(domain, *domains.draw_start(key, domain))


def is_pushed_left(hand: jax.Array, block: jax.Array, normal: jax.Array) -> jax.Array:
    """Whether a contact with unit `normal` (3,), block to hand, is on the right face and centred; () bool."""
    offset = hand - block
    centred = offset[0] ** 2 + offset[2] ** 2 < CENTRING**2
    return (normal[1] >= NORMAL_ALIGNMENT) & centred


def step(move: Callable[..., arm.Motion], domain: Block, state: PushState, action: jax.Array) -> PushState:
    """One step of 0.01 s by the physics `move`: `action` (3,) in [0, 1] drives the x, y and z sliders."""
    motion = move(domain, state.hand, state.block, action)
    hand = jnp.where(state.done, state.hand, motion.hand)
    block = jnp.where(state.done, state.block, motion.block)
    success = motion.touching & ~state.done & is_pushed_left(state.hand, state.block, motion.normal)
    return PushState(
        observation=observe(domain, hand, block),
        reward=jnp.where(success, jnp.float32(REWARD), 0.0),
        done=state.done | motion.touching,
        hand=hand,
        block=block,
        travelled=state.travelled + jnp.abs(jnp.concatenate([hand - state.hand, block - state.block])),
    )


def truncated(state: PushState) -> jax.Array:
    """Never: a rollout is over at its first contact or after its steps, () bool."""
    del state
    return jnp.array(False)


def position(domain: Block, state: PushState) -> jax.Array:
    """Cell of the hand on a 6 x 6 x 4 grid over its reach, () int32 in [0, 144)."""
    del domain
    share = (state.hand - arm.REACH_LOW) / (arm.REACH_HIGH - arm.REACH_LOW)
    cell = jnp.clip((share * GRID.astype(np.float32)).astype(jnp.int32), 0, GRID - 1)
    return (cell[0] * GRID[1] + cell[1]) * GRID[2] + cell[2]


def outcome(domain: Block, state: PushState) -> jax.Array:
    """Distances in metres travelled by hand and block along x, y and z, (6,)."""
    del domain
    return state.travelled
