"""MuJoCo (MJX) physics of box pushing, the physics of record.

MuJoCo moves the hand and the block, finds their contact and its normal. Between two steps only the positions
are kept, which makes rollouts small and cheap to drop: the sliders keep no velocity, and the block rests until
the first contact, which ends the rollout.
"""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
from mujoco import mjx

from qboot.envs.box_pushing import arm
from qboot.envs.box_pushing.domains import Block

MODEL_FILE = Path(__file__).with_name("model.xml")


@functools.cache
def model() -> tuple[mujoco.MjModel, mjx.Model, mjx.Data]:
    """The compiled model, and the model and its data as jax arrays."""
    compiled = mujoco.MjModel.from_xml_path(str(MODEL_FILE))
    with jax.ensure_compile_time_eval():  # the first call may come from inside a trace
        return compiled, mjx.put_model(compiled, impl="jax"), mjx.make_data(compiled, impl="jax")


def sized(domain: Block, centre_height: jax.Array) -> mjx.Model:
    """The model with the block of `domain` at height `centre_height` ()."""
    compiled, traced, _ = model()
    tip, reach = compiled.geom("tip"), compiled.geom("reach")
    grown = domain.half_size + arm.HALF_SIZE - tip.size[0]
    return traced.replace(
        geom_size=traced.geom_size.at[reach.id].set(grown),
        geom_pos=traced.geom_pos.at[reach.id, 2].set(centre_height),
    )


def move(domain: Block, hand: jax.Array, block: jax.Array, command: jax.Array) -> arm.Motion:
    """One step from centres `hand` (3,) and `block` (3,), both at rest, under `command` (3,) in [0, 1]."""
    effort = 2.0 * arm.admissible(hand, command) - 1.0
    # MuJoCo's sliders are chained from z to x, and the block slides along x and y.
    data = model()[2].replace(qpos=jnp.concatenate([hand[::-1], block[:2]]), ctrl=effort[::-1])
    with jax.numpy_dtype_promotion("standard"):  # MJX mixes kinds of numbers
        data = mjx.step(sized(domain, block[2]), data)
    contact = data._impl.contact  # MJX has no public access to it
    return arm.Motion(
        hand=data.qpos[2::-1],
        block=jnp.concatenate([data.qpos[3:], block[2:]]),
        touching=contact.dist[0] < 0.0,
        normal=-contact.frame[0, 0],  # MuJoCo's points from the hand's geom to the block's
    )
