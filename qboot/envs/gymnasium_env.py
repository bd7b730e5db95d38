"""Gymnasium's `Env` interface around a task; needs `pip install qboot[gymnasium]`."""

from typing import Any

import jax
import numpy as np

from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Task

try:
    import gymnasium
except ImportError as error:
    raise ImportError("GymnasiumEnv needs Gymnasium: pip install 'qboot[gymnasium]'") from error

FRAMES_PER_SECOND = 30  # of videos; tasks without a clock have no other


class GymnasiumEnv(gymnasium.Env):
    """A task as a `gymnasium.Env`, one robot at a time, its functions compiled by JAX.

    An episode is one rollout: terminated when the task says so, truncated when nothing happens any more or after
    `max_steps`. `reset(seed=...)` decides the start, and the domain if there are several. `info["domain"]` is its
    index.

    Example:
        >>> from qboot.envs import GymnasiumEnv, get_task  # doctest: +SKIP
        >>> env = GymnasiumEnv(get_task("ball_collecting"), domains="target", source="A")  # doctest: +SKIP
        >>> observation, info = env.reset(seed=0)  # doctest: +SKIP
        >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())  # doctest: +SKIP
    """

    def __init__(self, task: Task | TaskEnv, *, render_mode: str | None = None, **settings: Any):
        """Wrap a task in its own domains, or what is a Brax environment already.

        Args:
            task: a task, or one in the domains of a `TaskEnv`.
            render_mode: None, or "rgb_array" for tasks that say how they are drawn.
            **settings: of the `TaskEnv` around a task; by default it has the first source's domains.

        Raises:
            ValueError: as `TaskEnv`, for another render mode, or for settings of an environment that has its own.
        """
        if isinstance(task, TaskEnv):
            if settings:
                raise ValueError(f"{', '.join(settings)}: a TaskEnv has its settings already")
            self.env = task
        else:
            own_domain = "domain" in settings or "domains" in settings
            self.env = TaskEnv(task, **(settings if own_domain else {"domains": "source", **settings}))
        modes = ["rgb_array"] if self.env.task.view else []
        if render_mode is not None and render_mode not in modes:
            raise ValueError(f"render_mode is {render_mode!r}: {self.env.task.name} has {', '.join(modes) or 'none'}")
        self.metadata = {"render_modes": modes, "render_fps": FRAMES_PER_SECOND}
        self.render_mode = render_mode
        low, high = self.env.action_range
        sensors, effectors = (self.env.observation_size,), (self.env.action_size,)
        self.observation_space = gymnasium.spaces.Box(0.0, 1.0, sensors, np.float32)
        self.action_space = gymnasium.spaces.Box(low, high, effectors, np.float32)
        self._reset, self._step = jax.jit(self.env.reset), jax.jit(self.env.step)
        self._truncated = jax.jit(self.env.task.truncated)
        self._states: list = []
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Start a rollout: the observation (S,) and the info."""
        super().reset(seed=seed, options=options)
        key = jax.random.key(int(self.np_random.integers(2**31)))
        self._states, self._steps = [self._reset(key)], 0
        return np.asarray(self._states[0].obs), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One timestep with `action` (E,): observation (S,), reward, terminated, truncated, info.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._states:
            raise gymnasium.error.ResetNeeded("call reset before step")
        state = self._step(self._states[-1], np.asarray(action, np.float32))
        # Earlier states are kept for the path on the picture alone.
        self._states = [*self._states, state] if self.render_mode else [state]
        self._steps += 1
        terminated = bool(state.done)
        is_over = self._steps >= self.env.task.max_steps or bool(self._truncated(state.pipeline_state))
        truncated = is_over and not terminated
        return np.asarray(state.obs), float(state.reward), terminated, truncated, self._info()

    def render(self) -> np.ndarray | None:
        """A picture (H, W, 3) uint8 with the path so far, in the mode "rgb_array"."""
        return self.env.render(self._states) if self.render_mode and self._states else None

    def _info(self) -> dict[str, Any]:
        return {name: int(value) for name, value in self._states[-1].info.items()}
