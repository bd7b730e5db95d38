"""Closed-form physics of box pushing, the fast twin of `physics_mjx`.

The hand keeps no velocity and a rollout ends at its first contact, so the hand's motion is exact. Hand and block meet
as in `model.xml`: neither box turns, so their contact is that of a small sphere with the grown block. One frictionless
contact makes MuJoCo's constraint problem one-dimensional, and its solution is written out.
"""

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.box_pushing import arm
from qboot.envs.box_pushing.domains import Block

# The same numbers as in model.xml.
TIP = 0.001  # m, radius of the sphere; its edges round those of the grown block
SHARE_OF_ADVANCE = 0.54  # what the block moves by in the recorded contact steps
SHARE_OF_OVERLAP = 0.65
BLOCK_MASS = 0.01  # kg
ON_TABLE = np.array([1.0, 1.0, 0.0], np.float32)  # the table carries the block
# What a unit impulse does to the distance of hand and block, 1/kg: along each axis, and as MuJoCo estimates it.
INVERSE_MASS = 1.0 / arm.MOVED_MASS + ON_TABLE / BLOCK_MASS
MEAN_INVERSE_MASS = float(np.mean(1.0 / arm.MOVED_MASS)) + 1.0 / BLOCK_MASS


def contact(domain: Block, hand: jax.Array, block: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Overlap of hand and block at their centres `hand` (3,) and `block` (3,), as MuJoCo finds it.

    Returns:
        The depth () of the overlap in metres, negative where they are apart, and the unit normal (3,) from the block
        to the hand: an axis, but for a hand within a millimetre of an edge.
    """
    offset = hand - block
    grown = domain.half_size + arm.HALF_SIZE - TIP
    outside = jnp.abs(offset) - grown  # of the sphere's centre, along each axis
    side = jnp.where(offset > 0.0, 1.0, -1.0)
    least = jnp.max(outside)  # a centre inside leaves by the nearest face
    gap = jnp.maximum(outside, 0.0)
    distance = jnp.sqrt(jnp.sum(gap**2))
    beyond_edge = jnp.sum(gap > 0.0) > 1
    face = jnp.arange(3) == jnp.argmax(outside)
    normal = side * jnp.where(beyond_edge, gap / jnp.where(beyond_edge, distance, 1.0), face.astype(gap.dtype))
    return TIP - jnp.where(beyond_edge, distance, least), normal


def move(domain: Block, hand: jax.Array, block: jax.Array, command: jax.Array) -> arm.Motion:
    """One step from centres `hand` (3,) and `block` (3,) under `command` (3,) in [0, 1]."""
    displacement = arm.STEP_PER_COMMAND * (arm.admissible(hand, command) - 0.5)
    depth, normal = contact(domain, hand, block)
    touching = depth > 0.0
    # MuJoCo's soft constraint in one dimension: an impulse times a step, kg m, that acts on block and hand.
    yielding = SHARE_OF_ADVANCE * jnp.sum(normal**2 * INVERSE_MASS) + (1.0 - SHARE_OF_ADVANCE) * MEAN_INVERSE_MASS
    push = jnp.maximum(SHARE_OF_OVERLAP * depth - SHARE_OF_ADVANCE * jnp.dot(displacement, normal), 0.0) / yielding
    push = jnp.where(touching, push, 0.0) * normal
    return arm.Motion(
        hand=hand + displacement + push / arm.MOVED_MASS,
        block=block - push * ON_TABLE / BLOCK_MASS,
        touching=touching,
        normal=normal,
    )
