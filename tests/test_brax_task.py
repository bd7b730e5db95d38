"""Brax environments of one's own, and Brax's, as tasks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env, State

from qboot.envs import estimated_range, from_brax

SPEED = 0.1


class Line(Env):
    """A point on a line from -1 to 1, in state.obs; the reward is its place, it is done beyond 0.8.

    It does what environments do to make life hard: writes into its input's dictionaries, keeps a key in them, and
    returns a weak reward.
    """

    action_size, observation_size, backend, dt = 1, 2, "own", 0.5

    def reset(self, rng):
        where = 0.2 * jax.random.uniform(rng) - 0.1
        info = {"rng": rng, "nested": {"count": jnp.int32(0)}}
        return State(where, self._obs(where), 0.0, jnp.float32(0), {"far": jnp.float32(0)}, info)

    def step(self, state, action):
        where = jnp.clip(state.pipeline_state + SPEED * action[0], -1.0, 1.0)
        state.metrics.update(far=jnp.abs(where))
        state.info["rng"], _ = jax.random.split(state.info["rng"])
        state.info["nested"]["count"] += 1
        return state.replace(
            pipeline_state=where, obs=self._obs(where), reward=where, done=jnp.where(where > 0.8, 1.0, 0.0)
        )

    def _obs(self, where):
        return jnp.stack([where, where**2])


def line(**changes):
    settings = {"name": "line", "max_steps": 30, "observation_range": ([-1, 0], 1)}
    return from_brax(Line(), **(settings | changes))


def play(task, commands, domain=None, key=0):
    domain = task.source_domains(task.sources[0])[0] if domain is None else domain
    start = task.reset(jax.random.key(key), domain)

    @jax.jit
    def run(start, commands):
        def step(state, command):
            after = task.step(domain, state, command)
            return after, after

        return jax.lax.scan(step, start, commands)[1]

    return start, run(start, jnp.asarray(commands, jnp.float32)[:, None])


def test_the_environment_is_played_as_it_is_between_the_scales():
    task, env = line(), Line()
    start, states = play(task, np.linspace(0, 1, 20))
    state, expected = env.reset(jax.random.PRNGKey(0)), []
    for command in np.linspace(0, 1, 20):
        state = env.step(state, jnp.array([2 * command - 1]))
        expected.append(float(state.pipeline_state))
    np.testing.assert_allclose(states.env.pipeline_state, expected, atol=1e-6)
    np.testing.assert_allclose(states.reward, expected, atol=1e-6)  # dense, in units of 1
    where = np.array(expected)
    np.testing.assert_allclose(states.observation, np.stack([(where + 1) / 2, where**2], axis=1), atol=1e-6)
    assert (task.dt, task.reward, task.max_score_per_domain, len(task.sensors), task.effectors) == (
        0.5, 1.0, 1, 2, ("effector_0",),
    )  # fmt: skip
    assert int(start.env.info["nested"]["count"]) == 0  # what the environment writes in is not ours


def test_done_is_absorbing_and_earns_nothing():
    _, states = play(line(), np.ones(20))
    end = int(np.argmax(np.asarray(states.done)))
    assert states.done[end:].all() and not states.done[:end].any()
    assert states.reward[end] > 0.8 and not states.reward[end + 1 :].any()
    assert len(np.unique(states.env.pipeline_state[end:])) == 1
    assert int(states.env.info["nested"]["count"][-1]) == end + 1


class Fragile(Line):
    """The line, on which something is added to a number beyond 0.5: to the reward, or to what is observed."""

    def __init__(self, broken, added=jnp.nan):
        self.broken, self.added = broken, added

    def step(self, state, action):
        after = super().step(state, action)
        added = jnp.where(after.pipeline_state > 0.5, self.added, 0.0)
        return after.replace(**{self.broken: getattr(after, self.broken) + added})


@pytest.mark.parametrize(
    ("broken", "success"), [("reward", None), ("obs", None), ("obs", lambda state: state.pipeline_state > 0.5)]
)
def test_a_rollout_that_breaks_down_ends_where_it_was(broken, success):
    task = from_brax(Fragile(broken), name="fragile", max_steps=30, observation_range=([-1, 0], 1), success=success)
    _, states = play(task, np.ones(20))
    end = int(np.argmax(np.asarray(states.done)))
    assert 0 < end < 10 and states.done[end:].all() and not states.reward[end:].any()
    assert np.isfinite(states.observation).all() and np.isfinite(states.reward).all()
    assert 0.4 <= float(states.env.pipeline_state[-1]) <= 0.5


def test_an_infinite_sensor_is_at_the_end_of_its_range():
    task = from_brax(Fragile("obs", jnp.inf), name="far", max_steps=30, observation_range=([-1, 0], 1))
    _, states = play(task, np.ones(7))
    assert not states.done.any() and float(states.env.pipeline_state[-1]) > 0.5
    np.testing.assert_array_equal(states.observation[-1], 1.0)


def test_success_pays_once_and_ends_the_rollout():
    task = line(success=lambda state: state.pipeline_state < -0.5)
    _, states = play(task, np.zeros(20))
    assert np.asarray(states.reward).tolist().count(10.0) == 1 and float(states.reward.sum()) == 10.0 == task.reward
    assert states.done[int(np.argmax(np.asarray(states.reward))) :].all()
    _, never = play(task, np.full(20, 0.5))
    assert not never.reward.any() and not never.done.any()


def test_seeds_are_starts_and_arrays_are_what_reset_with_makes_of_them():
    task = line(source={"near": range(4), "far": [7]}, target={"near": [8], "far": [9, 10]})
    assert task.sources == ("near", "far")
    starts = [float(task.reset(jax.random.key(key), seed).env.pipeline_state) for key in (0, 1) for seed in range(4)]
    assert starts[:4] == starts[4:] and len(set(starts)) == 4
    assert starts[1] == float(Line().reset(jax.random.PRNGKey(1)).pipeline_state)
    assert [name for name, _ in task.view.domains()][-1] == "target 1 of far"

    def reset_with(key, place):
        return Line().reset(key).replace(pipeline_state=place, obs=jnp.stack([place, place**2]))

    placed = line(source=np.array([0.3, -0.4]), target=np.array([0.0]), reset_with=reset_with)
    np.testing.assert_allclose(placed.reset(jax.random.key(0), placed.source_domains("A")[1]).observation, [0.3, 0.16])


def test_what_is_compared_and_the_grid():
    task = line(grid=("square", "place"), sensors=("place", "square"), outcome=lambda state: state.pipeline_state)
    _, states = play(task, np.full(5, 0.9))
    domain, last = task.source_domains("A")[0], jax.tree.map(lambda leaf: leaf[-1], states)
    np.testing.assert_allclose(task.outcome(domain, last), [last.env.pipeline_state])
    place, square = np.asarray(last.observation)
    assert int(task.position(domain, last)) == int(place * 12) * 12 + int(square * 12)
    np.testing.assert_array_equal(line().outcome(domain, last), last.observation)
    scene = task.view.scene(domain, jax.device_get(states))
    np.testing.assert_array_equal(scene.movers[0].x, states.observation[:, 1])


def test_ranges_are_estimated_when_nobody_gives_them():
    low, high = estimated_range(Line())
    assert low[0] <= -0.8 and 0.8 <= high[0] <= 2 and high.dtype == np.float32
    task = line(observation_range=None, observe=lambda state: state.pipeline_state[None])
    _, states = play(task, np.full(5, 0.9))  # asked for while the rollout is compiled
    low, high = task.reset.__self__.sensor_range
    np.testing.assert_allclose(states.observation[:, 0], (states.env.pipeline_state - low) / (high - low), rtol=1e-5)


def test_a_task_is_static_and_works_batched_under_strict_types():
    task = line()
    assert hash(task) == hash(task._replace(max_steps=30)) and task == task._replace(max_steps=30)
    assert task != line()  # another environment, other compiled programs
    domains = task.source_domains("A")
    with jax.numpy_dtype_promotion("strict"):
        states = jax.vmap(task.reset)(jax.random.split(jax.random.key(0), 3), domains)
        step = jax.jit(jax.vmap(task.step))
        for _ in range(3):
            states = step(domains, states, jnp.full((3, 1), 0.5))
    assert step._cache_size() == 1  # types do not change from step to step


def test_dictionaries_of_observations_are_flattened():
    class Two(Line):
        def _obs(self, where):
            return {"privileged": jnp.zeros(3), "state": jnp.stack([where, where**2])}

    assert len(from_brax(Two(), name="two", max_steps=5, observation_range=(-1, 1)).sensors) == 2
    every = from_brax(Two(), name="two", max_steps=5, observe=lambda state: jnp.concatenate([*state.obs.values()]),
                      observation_range=(-1, 1))  # fmt: skip
    assert len(every.sensors) == 5


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensors": ("one",)}, "1 different names of sensors are given, the environment has 2"),
        ({"effectors": ("a", "b")}, "2 different names of effectors are given, the environment has 1"),
        ({"source": np.array([0.5])}, "domains are whole numbers"),
        ({"source": []}, "at least 1 long"),
        ({"source": {"A": [0]}, "target": {"B": [0]}}, "must name the same sources"),
        ({"observation_range": (1, -1)}, "low below high"),
        ({"grid": ("sensor_0", "speed")}, "two of the sensors sensor_0, sensor_1"),
        ({"max_steps": 0}, "max_steps is 0: it must be at least 1"),
        ({"max_score": 0}, "max_score is 0: it must be at least 1"),
        ({"rollouts_per_domain": 0}, "rollouts_per_domain is 0: it must be at least 1"),
        ({"trajectory_period": 0}, "trajectory_period is 0: it must be at least 1"),
        ({"reward": 0.0}, "reward is 0.0: it must be above 0"),
        ({"reward": np.nan}, "reward is nan: it must be above 0"),
    ],
)
def test_what_does_not_fit_is_named(changes, words):
    with pytest.raises(ValueError, match=words):
        line(**changes)


def test_entries_that_appear_in_step_are_named():
    class Late(Line):
        def step(self, state, action):
            after = super().step(state, action)
            return after.replace(info=after.info | {"late": jnp.float32(1)})

    with pytest.raises(ValueError, match="metrics and info must have the same entries"):
        from_brax(Late(), name="late", max_steps=5)
