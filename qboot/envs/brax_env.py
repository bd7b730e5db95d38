"""Brax's `Env` interface around one domain of a task."""

import contextlib
import io

import jax
import jax.numpy as jnp

from qboot.envs.task import Domain, Task

# Brax loads MJX, which tells on stdout what optional packages it lacks. Stdout belongs to the programs.
with contextlib.redirect_stdout(io.StringIO()):
    from brax.envs.base import Env, State


class TaskEnv(Env):
    """One domain of a task as a `brax.envs.base.Env`; `pipeline_state` holds the task's own state."""

    def __init__(self, task: Task, domain: Domain):
        """Wrap `task` in the one `domain` (no leading axis D)."""
        self.task = task
        self.domain = jax.tree.map(jnp.asarray, domain)

    def reset(self, rng: jax.Array) -> State:
        """State at the start of a rollout; `rng` is a jax random key."""
        return self._wrap(self.task.reset(rng, self.domain), {}, {})

    def step(self, state: State, action: jax.Array) -> State:
        """One step with `action` (E,) in [0, 1]."""
        after = self.task.step(self.domain, state.pipeline_state, action)
        return self._wrap(after, state.metrics, state.info)

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
