"""Brax's `Env` interface around a task."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State

from qboot.envs.task import Domain, Task

NEUTRAL = 0.5  # the command, of [0, 1], that an action which is not a number becomes
DOTS_PER_INCH = 100


class TaskEnv(Env):
    """A task as a `brax.envs.base.Env`; `pipeline_state` holds the task's own state.

    With one domain, every rollout is in it. With a set of them, `reset` draws one by its key, and its index is
    `info["domain"]`. Brax's `AutoResetWrapper` goes back to the state of the first reset, hence to the same domain:
    over many environments side by side, as Brax trains, all domains appear.

    An episode does not end by itself where the task only tires (`Task.truncated`) or after `max_steps`: as with every
    Brax environment, `EpisodeWrapper(env, env.task.max_steps, 1)` ends it and marks it as truncated.

    Example:
        >>> import jax
        >>> from qboot.envs import TaskEnv, get_task
        >>> env = TaskEnv(get_task("box_pushing", "kinematic"), domains="target", action_range=(-1.0, 1.0))
        >>> state = env.reset(jax.random.key(0))
        >>> state = env.step(state, jax.numpy.zeros(env.action_size))
        >>> state.obs.shape, env.dt
        ((13,), 0.01)
    """

    def __init__(
        self,
        task: Task,
        domain: Domain | None = None,
        *,
        domains: Domain | str | None = None,
        source: str | None = None,
        action_range: tuple[float, float] = (0.0, 1.0),
    ):
        """Wrap a task in one domain, or in a set of them.

        Args:
            task: the task.
            domain: the one domain (no leading axis D).
            domains: or the set (D, ...) that `reset` draws from; "source" or "target" for the task's own sets.
            source: name of the source domain set that "source" and "target" belong to; default the task's first.
            action_range: what actions lie in. They are scaled to the task's commands in [0, 1]; outside they are
                clipped, and one that is not a number becomes the middle.

        Raises:
            ValueError: unless there is either a domain or a set of them, the range is one, and a source is known and
                given with "source" or "target".
        """
        low, high = action_range
        if not -np.inf < low < high < np.inf:
            raise ValueError(f"action_range is {action_range}: it must be (low, high), finite, low below high")
        if (domain is None) == (domains is None):
            raise ValueError("give either one domain or domains, a set of them")
        if source is not None and not isinstance(domains, str):
            raise ValueError(f"source is {source!r}, but belongs to domains='source' or domains='target' alone")
        if isinstance(domains, str):
            sets = {"source": task.source_domains, "target": task.target_domains}
            if domains not in sets:
                raise ValueError(f"domains is {domains!r}: it must be source or target, or a set of domains")
            domains = sets[domains](task.sources[0] if source is None else source)
        self.task = task
        self.domain = None if domain is None else jax.tree.map(jnp.asarray, domain)
        self.domains = None if domains is None else jax.tree.map(jnp.asarray, domains)
        self.action_range = (float(low), float(high))

    def reset(self, rng: jax.Array) -> State:
        """State at the start of a rollout; `rng` is a jax random key."""
        if self.domains is None:
            return self._wrap(self.task.reset(rng, self.domain), {}, {})
        key_domain, key_start = jax.random.split(rng)
        n_domains = len(jax.tree.leaves(self.domains)[0])
        info = {"domain": jax.random.randint(key_domain, (), 0, n_domains)}
        return self._wrap(self.task.reset(key_start, self._domain(info)), {}, info)

    def step(self, state: State, action: jax.Array) -> State:
        """One step with `action` (E,) in the action range; outside it is clipped, NaN is the middle."""
        after = self.task.step(self._domain(state.info), state.pipeline_state, self.commands(action))
        return self._wrap(after, state.metrics, state.info)

    def commands(self, action: jax.Array) -> jax.Array:
        """The task's commands (E,) in [0, 1] that an action (E,) stands for."""
        low, high = self.action_range
        share = (jnp.asarray(action, jnp.float32) - low) / (high - low)
        return jnp.where(jnp.isnan(share), NEUTRAL, jnp.clip(share, 0.0, 1.0))

    def render(self, states: State | list[State], height: int = 480, width: int = 480) -> np.ndarray:
        """A picture (height, width, 3) uint8 of the task at a state, with the path there if there are several.

        Args:
            states: one state that is not batched, or those of one rollout in turn.
            height: in pixels.
            width: in pixels.

        Raises:
            ValueError: if the task does not say how it is drawn.
        """
        if self.task.view is None:
            raise ValueError(f"{self.task.name} does not say how it is drawn: give its Task a `view`")
        some = [states] if isinstance(states, State) else list(states)
        frames = jax.tree.map(lambda *leaves: np.stack(leaves), *(jax.device_get(one.pipeline_state) for one in some))
        # Those who only simulate need no matplotlib.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from qboot.study.figures.drawing import draw_path, draw_scene

        scene = self.task.view.scene(self._domain(some[-1].info), frames)
        canvas = FigureCanvasAgg(Figure((width / DOTS_PER_INCH, height / DOTS_PER_INCH), dpi=DOTS_PER_INCH))
        axes = canvas.figure.add_axes((0.01, 0.01, 0.98, 0.98))
        draw_scene(axes, scene, frame=len(some) - 1)
        for mover in scene.movers:
            if len(mover.x) > 1:
                draw_path(axes, mover, mover.colour)
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    def _domain(self, info: dict) -> Domain:
        """The domain of a rollout."""
        return self.domain if self.domains is None else jax.tree.map(lambda leaf: leaf[info["domain"]], self.domains)

    def _wrap(self, state: Any, metrics: dict, info: dict) -> State:
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
    def dt(self) -> float:
        """Seconds of one step; 1 where the task has no clock."""
        return self.task.dt

    @property
    def backend(self) -> str:
        """Brax's name of the physics; qboot's tasks bring their own."""
        return "qboot"
