"""Brax's two-joint arm as a task.

qboot evolve --task examples/reacher.py:TASK --profile quick --out runs/reacher/A-0
"""

import brax.envs
import jax.numpy as jnp
import numpy as np

from qboot.envs import from_brax
from qboot.envs.scene import BLUE, GREEN, ORANGE, Scene, Shape

REACHED = 0.04  # m between fingertip and target
ONE, TARGET, SPEED, APART = [1.0] * 4, [0.2] * 2, [2.0] * 2, [0.4, 0.4, 0.01]


def is_reached(state):
    """Whether the fingertip is at the target, () bool: the last three entries of Brax's observation tell how far."""
    return jnp.linalg.norm(state.obs[-3:]) < REACHED


def scene(domain, states):
    """The arm from above; states (F, ...)."""
    obs = np.asarray(states.env.obs)
    target, tip = obs[:, 4:6], obs[:, 4:6] + obs[:, 8:10]
    elbow = np.asarray(states.env.pipeline_state.x.pos)[:, 1, :2]
    reached = np.asarray(states.done)
    joint = Shape("elbow", *elbow.T, 0.008, None, BLUE)
    finger = Shape("fingertip", *tip.T, 0.01, None, BLUE, active=reached, active_colour=ORANGE, active_label="reached")
    goal = Shape("target", *target.T, REACHED, None, GREEN)
    return Scene(-0.25, 0.25, 0.25, -0.25, (goal, joint, finger), (finger,))


TASK = from_brax(
    brax.envs.get_environment("reacher"),
    name="reacher",
    max_steps=60,
    success=is_reached,
    observation_range=(-np.array(ONE + TARGET + SPEED + APART), np.array(ONE + TARGET + SPEED + APART)),
    sensors=("cos_1", "cos_2", "sin_1", "sin_2", "target_x", "target_y", "speed_x", "speed_y", "to_x", "to_y", "to_z"),
    effectors=("shoulder", "elbow"),
    source=range(3),  # each seed is a fixed start of the arm and a place of the target
    target=range(3, 6),
    grid=("to_x", "to_y"),
    scene=scene,
)
