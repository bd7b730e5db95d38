"""Any Brax environment as a task: what is sensed, what is reached, where it starts, how behaviours are compared."""

import functools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.brax_state import observed, raw, settled, settled_shapes, unless
from qboot.envs.domain_sets import Sets, all_domains, are_seeds, set_of, sets_by_name
from qboot.envs.scene import BLUE, ORANGE, Scene, Shape
from qboot.envs.sensor_range import checked_range, estimated_range
from qboot.envs.task import Domain, Task, View

CELLS = 12  # of the discretised trajectory, along each of its two sensors
POINTS_OF_A_ROLLOUT = 50  # recorded cells
NOTE = "The robot is a point in the plane of two of its sensors: {}, from 0 on the left to 1 on the right, and {}."


class BraxState(NamedTuple):
    """State of one rollout; the first three fields are those of every task."""

    observation: jax.Array  # (S,) in [0, 1]
    reward: jax.Array  # () float32
    done: jax.Array  # () bool
    env: Any  # the environment's own state: obs, pipeline_state, info ...


def from_brax(
    env: Any,
    *,
    name: str,
    max_steps: int,
    success: Callable[[Any], jax.Array] | None = None,
    reward: float | None = None,
    max_score: int = 1,
    observe: Callable[[Any], jax.Array] | None = None,
    observation_range: tuple[Any, Any] | None = None,
    action_range: tuple[Any, Any] = (-1.0, 1.0),
    sensors: Sequence[str] | None = None,
    effectors: Sequence[str] | None = None,
    source: Domain | Mapping[str, Domain] = (0, 1, 2),
    target: Domain | Mapping[str, Domain] = (3, 4, 5),
    reset_with: Callable[[jax.Array, Domain], Any] | None = None,
    rollouts_per_domain: int = 1,
    outcome: Callable[[Any], jax.Array] | None = None,
    grid: tuple[int | str, int | str] | None = None,
    trajectory_period: int | None = None,
    scene: Callable[[Domain, Any], Scene] | None = None,
    dt: float | None = None,
    **changes: Any,
) -> Task:
    """A Brax environment as a `Task`, for every command and every room of this package.

    What is reached is told in one of two ways. With `success`, the first state for which it is true pays `reward` and
    ends the rollout: the score counts the rollouts that reached it. Without, the environment's own rewards count, and
    may be dense: the score of a rollout is their sum divided by `reward`, any fraction, negative where they are.

    A rollout that is done stays where it is and earns nothing. A step after which the reward is not finite, or what is
    observed is NaN, ends the rollout where it was before, without a reward. A rollout is never truncated before
    `max_steps`. Give the bare environment: wrappers that count episodes or reset by themselves would do so a second
    time.

    Args:
        env: a `brax.envs.Env`, or what has the same `reset(key)` -> state, `step(state, action)` -> state and
            `action_size`, as MuJoCo Playground's environments.
        name: of the task.
        max_steps: timesteps of a rollout at most.
        success: the environment's state -> () bool.
        reward: size of one reward, > 0; default 10 with `success`, else 1.
        max_score: the greatest score of a rollout, where figures end.
        observe: the environment's state -> (S,) float; default its `obs`, flattened (of a dict, the entry "state" if
            it has one, else all in order of their names).
        observation_range: lowest and highest value of what is observed, each () or (S,); scaled to [0, 1] and clipped.
            Default: `estimated_range`, which costs the compilation of a rollout in every process: better write down
            what it says.
        action_range: of the environment's actions, each () or (E,); commands in [0, 1] are scaled to it.
        sensors: names; default sensor_0 and so on.
        effectors: names; default effector_0 and so on.
        source: the source set of domains, or a mapping of such sets by their names. A set is whole numbers (D,), seeds,
            or with `reset_with` a pytree of arrays with leading axis D. A seed is one fixed start,
            `env.reset(jax.random.PRNGKey(seed))`.
        target: the target set, or a mapping by the same names.
        reset_with: (key, domain) -> the environment's state, for domains that are arrays.
        rollouts_per_domain: in each domain; more than 1 makes sense for starts that depend on the key.
        outcome: the environment's state -> (k,), compared by the ad hoc distance; default the last observation.
        grid: two sensors, by names or places, whose plane the discretised trajectory has 12 x 12 cells in; default the
            first two.
        trajectory_period: timesteps between two recorded cells; default such that there are about 50.
        scene: (domain, `BraxState` (F, ...)) -> how the rollout is drawn; default a point in the plane of `grid`.
        dt: seconds of one timestep; default the environment's `dt`, or 1 if it has none.
        **changes: other fields of `Task`, such as `expert` or `defaults`.

    Raises:
        ValueError: if a value does not fit the environment.

    Example:
        >>> import brax.envs
        >>> import jax
        >>> from qboot.envs import from_brax
        >>> task = from_brax(brax.envs.get_environment("fast"), name="fast", max_steps=10, observation_range=(0, 10))
        >>> task.sensors, task.effectors
        (('sensor_0', 'sensor_1'), ('effector_0',))
        >>> domain = jax.tree.map(lambda leaf: leaf[0], task.source_domains("A"))
        >>> state = task.reset(jax.random.key(0), domain)
        >>> state = task.step(domain, state, jax.numpy.array([0.5]))
        >>> bool(state.done)
        False
    """
    counts = {
        "max_steps": max_steps,
        "max_score": max_score,
        "rollouts_per_domain": rollouts_per_domain,
        "trajectory_period": 1 if trajectory_period is None else trajectory_period,
    }
    for what, count in counts.items():
        if count < 1:
            raise ValueError(f"{name}: {what} is {count}: it must be at least 1")
    if reward is not None and not 0 < reward < np.inf:
        raise ValueError(f"{name}: reward is {reward}: it must be above 0 and finite, for scores are divided by it")
    sources, source_sets, target_sets = sets_by_name(source, target)
    first = jax.tree.map(lambda leaf: leaf[0], source_sets[sources[0]])
    if reset_with is None and any(not are_seeds(some) for some in (*source_sets.values(), *target_sets.values())):
        raise ValueError(f"{name}: domains are whole numbers (seeds), unless reset_with tells how to start in them")
    template = settled_shapes(env, functools.partial(_start, env, reset_with), first, name)
    n_sensors = jax.eval_shape(observe or observed, template).size
    sensor_names = _named(name, "sensors", sensors, n_sensors)
    robot = _Robot(
        env=env,
        template=template,
        start=functools.partial(_start, env, reset_with),
        success=success,
        reward=(1.0 if success is None else 10.0) if reward is None else float(reward),
        observe=observe or observed,
        bounds=None if observation_range is None else checked_range(name, "observation_range", observation_range),
        actions=checked_range(name, "action_range", action_range),
        outcome=outcome,
        plane=_plane(name, grid, sensor_names),
        first=first,
    )
    task = Task(
        name=name,
        sensors=sensor_names,
        effectors=_named(name, "effectors", effectors, env.action_size),
        sources=sources,
        max_steps=max_steps,
        rollouts_per_domain=rollouts_per_domain,
        max_score_per_domain=max_score * rollouts_per_domain,
        reward=robot.reward,
        reset=robot.reset,
        step=robot.step,
        truncated=_never,
        source_domains=functools.partial(set_of, name, Sets(source_sets)),
        target_domains=functools.partial(set_of, name, Sets(target_sets)),
        position=robot.position,
        outcome=robot.final,
        trajectory_period=trajectory_period or max(1, max_steps // POINTS_OF_A_ROLLOUT),
        dt=round(float(getattr(env, "dt", 1.0) if dt is None else dt), 6),
    )
    domains = functools.partial(all_domains, Sets(source_sets), Sets(target_sets))
    across, down = (sensor_names[place] for place in robot.plane)
    note = NOTE.format(across, down) if scene is None else ""
    return task._replace(**({"view": View(scene or robot.scene, domains, note)} | changes))


@dataclass(frozen=True, eq=False)
class _Robot:
    """The functions of a task around one environment; each instance is another robot, as a static argument is."""

    env: Any
    template: Any  # the environment's state as shapes and types
    start: Callable[[jax.Array, Domain], Any]
    success: Callable[[Any], jax.Array] | None
    reward: float
    observe: Callable[[Any], jax.Array]
    bounds: tuple[np.ndarray, np.ndarray] | None
    actions: tuple[np.ndarray, np.ndarray]
    outcome: Callable[[Any], jax.Array] | None
    plane: tuple[int, int]
    first: Domain

    @functools.cached_property
    def sensor_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest value of each sensor; estimated, if need be, when it is asked for first."""
        if self.bounds is not None:
            return self.bounds
        # It may be asked for while something else is being traced; another thread is outside of that.
        with ThreadPoolExecutor(1) as outside:
            reset = functools.partial(_swapped, self.start, self.first)
            return outside.submit(estimated_range, self.env, self.observe, self.actions, reset).result()

    def reset(self, key: jax.Array, domain: Domain) -> BraxState:
        """State at the start of a rollout."""
        state = settled(self.start(key, domain), self.template)
        return BraxState(self.sense(self.observe(state)), jnp.float32(0.0), state.done > 0, state)

    def step(self, domain: Domain, state: BraxState, command: jax.Array) -> BraxState:
        """One timestep; a state that is done stays as it is, and earns nothing, and so does one that breaks down."""
        del domain
        low, high = self.actions
        # Some environments write into the dictionaries of the state that they are given: they get new ones.
        before = jax.tree.map(lambda leaf: leaf, state.env)
        after = settled(self.env.step(before, low + command * (high - low)), self.template)
        if self.success is None:
            reward, over = after.reward.astype(jnp.float32), after.done > 0
        else:
            reached = jnp.asarray(self.success(after)).astype(jnp.float32) > 0
            reward, over = jnp.where(reached, jnp.float32(self.reward), jnp.float32(0.0)), (after.done > 0) | reached
        # One number that is none would be everybody's: rewards and outcomes of a population are compared.
        seen = self.observe(after)
        # A sensor that is infinite is at the end of its range.
        breaks_down = ~jnp.isfinite(reward) | jnp.any(jnp.isnan(seen))
        stays = state.done | breaks_down
        return BraxState(
            observation=jnp.where(stays, state.observation, self.sense(seen)),
            reward=jnp.where(stays, jnp.float32(0.0), reward),
            done=stays | over,
            env=unless(stays, after, state.env),
        )

    def sense(self, seen: jax.Array) -> jax.Array:
        """Sensors (S,) in [0, 1] of what is observed, (S,)."""
        low, high = self.sensor_range
        return jnp.clip((seen.astype(jnp.float32) - low) / (high - low), 0.0, 1.0)

    def position(self, domain: Domain, state: BraxState) -> jax.Array:
        """Cell of two sensors on a 12 x 12 grid, () int32 in [0, 144)."""
        del domain
        column, row = (
            jnp.clip((state.observation[place] * CELLS).astype(jnp.int32), 0, CELLS - 1) for place in self.plane
        )
        return row * CELLS + column

    def final(self, domain: Domain, state: BraxState) -> jax.Array:
        """What the ad hoc distance compares."""
        del domain
        if self.outcome is None:
            return state.observation
        return jnp.asarray(self.outcome(state.env)).reshape(-1).astype(jnp.float32)

    def scene(self, domain: Domain, states: BraxState) -> Scene:
        """The robot as a point in the plane of two sensors, drawn upwards; states (F, ...)."""
        del domain
        x, y = (np.asarray(states.observation)[:, place] for place in self.plane)
        point = Shape("robot", x, y, 0.02, None, BLUE, active=np.asarray(states.done), active_colour=ORANGE,
                      active_label="robot, rollout over")  # fmt: skip
        return Scene(0.0, 1.0, 1.0, 0.0, (point,), (point,))


def _start(env: Any, reset_with: Callable | None, key: jax.Array, domain: Domain) -> Any:
    if reset_with is None:
        return env.reset(jax.random.PRNGKey(domain))
    return reset_with(raw(key), domain)


def _never(state: BraxState) -> jax.Array:
    """No rollout is truncated, () bool."""
    del state
    return jnp.array(False)


def _named(name: str, kind: str, given: Sequence[str] | None, n: int) -> tuple[str, ...]:
    if given is None:
        return tuple(f"{kind.removesuffix('s')}_{place}" for place in range(n))
    if len(given) != n or len(set(given)) != n:
        raise ValueError(f"{name}: {len(set(given))} different names of {kind} are given, the environment has {n}")
    return tuple(given)


def _plane(name: str, grid: tuple[int | str, int | str] | None, sensors: tuple[str, ...]) -> tuple[int, int]:
    wanted = grid or (0, min(1, len(sensors) - 1))
    places = [sensors.index(one) if one in sensors else one for one in wanted]
    if len(places) != 2 or any(not isinstance(one, int) or not 0 <= one < len(sensors) for one in places):
        raise ValueError(f"{name}: grid is {grid}: it must be two of the sensors {', '.join(sensors)}")
    return int(places[0]), int(places[1])


def _swapped(start: Callable, domain: Domain, key: jax.Array) -> Any:
    return start(key, domain)
