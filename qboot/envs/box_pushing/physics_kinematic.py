"""Closed-form physics of box pushing, the fast twin of `physics_mjx`.

The hand keeps no velocity and a rollout ends at its first contact, so hand, contact and face are exact. The
block's shift in the contact step is quasi-static: fixed shares of the hand's advance and of the overlap.
"""

import jax
import jax.numpy as jnp

from qboot.envs.box_pushing import arm, domains
from qboot.envs.box_pushing.domains import Block

# What the block moves by in the recorded contact steps, the same numbers as in model.xml.
SHARE_OF_ADVANCE = 0.54
SHARE_OF_OVERLAP = 0.65


def move(domain: Block, hand: jax.Array, block: jax.Array, command: jax.Array) -> arm.Motion:
    """One step from centres `hand` (3,) and `block` (3,) under `command` (3,) in [0, 1]."""
    displacement = arm.STEP_PER_COMMAND * (arm.admissible(hand, command) - 0.5)
    depths = domains.overlap_depths(domain, hand, block)
    touching = jnp.all(depths > 0.0)
    face = jnp.arange(3) == jnp.argmin(depths)  # two boxes part most easily along the axis of least overlap
    normal = jnp.where(face, jnp.where(hand > block, 1.0, -1.0), 0.0)
    shift = jnp.maximum(SHARE_OF_OVERLAP * depths - SHARE_OF_ADVANCE * displacement * normal, 0.0) * normal
    sideways = jnp.array([True, True, False])  # the table carries the block
    return arm.Motion(
        hand=hand + displacement,
        block=block - jnp.where(touching & sideways, shift, 0.0),
        touching=touching,
        normal=normal,
    )
