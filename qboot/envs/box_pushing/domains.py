"""The domains of box pushing: three source and three target blocks (paper, figure 11), and where rollouts start.

The source sizes are the recorded ones. The target sizes are ours, chosen between and just below them by the
same rule of growth: side 0.03 + 0.02 w and height 0.04 + 0.01 w metres, with w = 1, 2, 3 for the source and
w = 0.5, 1.5, 2.5 for the target blocks.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.box_pushing import arm

SOURCE_WIDTHS = (1.0, 2.0, 3.0)
TARGET_WIDTHS = (0.5, 1.5, 2.5)
TABLE_TOP = 0.69  # m
TABLE_LOW = np.array([-0.15, -0.55], np.float32)  # x, y of the table's edges
TABLE_HIGH = np.array([0.55, 0.55], np.float32)

# Where a rollout starts. A block too far in y leaves the hand no room to push; no recorded one has y > -0.05.
BLOCK_LOW = np.array([0.16, -0.26], np.float32)  # x, y of the block's centre
BLOCK_HIGH = np.array([0.53, -0.05], np.float32)
HAND_LOW = np.array([0.08, -0.34, 0.72], np.float32)
HAND_HIGH = np.array([0.60, 0.11, 0.82], np.float32)
N_CANDIDATES = 16  # about one draw in ten overlaps, so all of them do in one reset of 10^16


class Block(NamedTuple):
    """One domain; a set of domains has a leading axis D."""

    half_size: jax.Array  # (3,) m


def block(width: float) -> Block:
    """The block of width index `width` (1, 2, 3 in the recorded runs)."""
    side, height = 0.03 + 0.02 * width, 0.04 + 0.01 * width
    return Block(jnp.array([side / 2, side / 2, height / 2], jnp.float32))


def stacked(widths: tuple[float, ...]) -> Block:
    """A set of domains, leading axis D = len(widths)."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(block, widths))


def source_domains(source: str) -> Block:
    """The three source blocks (D = 3, ...); raises ValueError for a source other than A."""
    _check_source(source)
    return stacked(SOURCE_WIDTHS)


def target_domains(source: str) -> Block:
    """The three target blocks (D = 3, ...); raises ValueError for a source other than A."""
    _check_source(source)
    return stacked(TARGET_WIDTHS)


def _check_source(source: str) -> None:
    if source != "A":
        raise ValueError(f"unknown source {source!r} of box pushing: there is only A")


def overlap_depths(domain: Block, hand: jax.Array, centre: jax.Array) -> jax.Array:
    """How far hand and block, both axis-aligned boxes, overlap along each axis, (3,); negative: apart."""
    return domain.half_size + arm.HALF_SIZE - jnp.abs(hand - centre)


def draw_start(key: jax.Array, domain: Block) -> tuple[jax.Array, jax.Array]:
    """Random centres of hand (3,) and block (3,) that do not overlap: the first of some candidates."""
    hand_key, block_key = jax.random.split(key)
    hands = jax.random.uniform(hand_key, (N_CANDIDATES, 3), minval=HAND_LOW, maxval=HAND_HIGH)
    places = jax.random.uniform(block_key, (N_CANDIDATES, 2), minval=BLOCK_LOW, maxval=BLOCK_HIGH)
    heights = jnp.full((N_CANDIDATES, 1), TABLE_TOP + domain.half_size[2])
    centres = jnp.concatenate([places, heights], axis=1)
    apart = jnp.any(overlap_depths(domain, hands, centres) < 0.0, axis=1)
    first = jnp.argmax(apart)
    return hands[first], centres[first]
