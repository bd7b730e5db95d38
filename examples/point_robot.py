"""A point robot of one's own.

qboot evolve --task examples/point_robot.py:TASK --profile quick --out runs/point_robot/A-0
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs import Task, View
from qboot.envs.scene import BLUE, GREEN, Scene, Shape, disc

REACHED, SPEED = 0.1, 0.04  # of a square room with sides of 1
SOURCE = np.array([[0.5, 0.5, 0.9, 0.8], [0.5, 0.5, 0.2, 0.9], [0.5, 0.5, 0.8, 0.1]], np.float32)  # start, goal
TARGET = np.array([[0.1, 0.1, 0.9, 0.9], [0.9, 0.5, 0.1, 0.5], [0.5, 0.9, 0.6, 0.1]], np.float32)


class PointState(NamedTuple):
    """The first three fields are those of every task."""

    observation: jax.Array  # (6,) in [0, 1]
    reward: jax.Array
    done: jax.Array
    where: jax.Array  # (2,)


def state_at(domain, where, reward, done):
    """Four eyes see how far the goal is to the right, left, below and above, from 1 here to 0; two feel the walls."""
    offset = domain[2:] - where
    eyes = jnp.concatenate([jnp.where(offset > 0, 1 - offset, 0), jnp.where(offset < 0, 1 + offset, 0)])
    walls = (jnp.abs(where - 0.5) > 0.49).astype(jnp.float32)
    return PointState(jnp.concatenate([eyes, walls]), reward, done, where)


def reset(key, domain):
    """Start where the domain says."""
    return state_at(domain, domain[:2], jnp.float32(0), jnp.array(False))


def step(domain, state, command):
    """Move along x and y; the goal pays once and ends the rollout, after which nothing moves."""
    moved = jnp.clip(state.where + SPEED * (2 * command - 1), 0, 1)
    where = jnp.where(state.done, state.where, moved)
    arrives = (jnp.linalg.norm(domain[2:] - where) < REACHED) & ~state.done
    return state_at(domain, where, jnp.where(arrives, 10.0, 0.0), state.done | arrives)


def scene(domain, states):
    """The room from above; states (F, ...)."""
    robot = Shape("robot", *np.asarray(states.where).T, 0.02, None, BLUE)
    return Scene(0, 0, 1, 1, (disc("goal", np.asarray(domain[2:]), REACHED, GREEN), robot), (robot,))


TASK = Task(
    name="point_robot",
    sensors=("goal_right", "goal_below", "goal_left", "goal_above", "wall_x", "wall_y"),
    effectors=("x", "y"),
    sources=("A",),
    max_steps=60,
    rollouts_per_domain=1,
    max_score_per_domain=1,
    reward=10.0,
    reset=reset,
    step=step,
    truncated=lambda state: jnp.array(False),
    source_domains=lambda source: SOURCE,
    target_domains=lambda source: TARGET,
    position=lambda domain, state: jnp.dot((state.where * 11.99).astype(jnp.int32), jnp.array([1, 12])),
    outcome=lambda domain, state: state.where,
    trajectory_period=2,
    view=View(scene, lambda: [(f"domain {i}", domain) for i, domain in enumerate([*SOURCE, *TARGET])], "Our rooms."),
)
