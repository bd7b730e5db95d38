"""Brax's `Env` interface around one domain of a task."""

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

from qboot.envs.types import Domain, Task


class TaskEnv(Env):
    """One domain of a task as a `brax.envs.base.Env`; `pipeline_state` holds the task's own state."""

    def __init__(self, task: Task, domain: Domain):
        self.task = task
        self.domain = jax.tree.map(jnp.asarray, domain)

    def reset(self, rng: jax.Array) -> State:
        """State at the start of a test; `rng` is a jax random key."""
        return self._wrap(self.task.reset(rng, self.domain), {}, {})

    def step(self, state: State, action: jax.Array) -> State:
        """One step with `action` (E,) in [0, 1]."""
        return self._wrap(self.task.step(self.domain, state.pipeline_state, action), state.metrics, state.info)

    def _wrap(self, state, metrics: dict, info: dict) -> State:
        return State(
            pipeline_state=state,
            obs=state.observation,
            reward=state.reward.astype(jnp.float32),
            done=state.done.astype(jnp.float32),
            metrics=metrics,
            info=info,
        )

    @property
    def observation_size(self) -> int:
        """Number of sensors S."""
        return len(self.task.sensors)

    @property
    def action_size(self) -> int:
        """Number of effectors E."""
        return len(self.task.effectors)

    @property
    def backend(self) -> str:
        """Brax's name of the physics; qboot's tasks bring their own."""
        return "qboot"
