"""The mobile robot against recorded runs of the fastsim simulator, and the task's rules by hand."""

import sys
from functools import partial
from pathlib import Path

import brax.envs
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.wrappers.training import EpisodeWrapper, VmapWrapper

from experiments import parity
from qboot.envs import BallCollecting, geometry
from qboot.envs.ball_collecting import TASK
from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.ball_collecting import dynamics as ball_collecting

RECORDING = Path(__file__).parent / "data" / "fastsim_600_r20.npz"
ARENA = jax.device_get(arenas.arena("A", 0))
reset, step, touch = jax.jit(partial(TASK.reset, None)), jax.jit(TASK.step), jax.jit(ball_collecting.touch)


def at(domain, x, y, theta, **fields):
    """A state with the robot at a posture."""
    state = reset(domain)
    return state._replace(posture=ball_collecting.Posture(*map(jnp.float32, (x, y, theta))), **fields)


def test_one_step_is_that_of_fastsim():
    result = parity.fastsim(parity.load(RECORDING))
    assert result["steps"] == 4000
    assert result["posture_error_max"] <= 1e-3
    assert result["collision_agreement"] >= 0.99
    assert result["laser_within_2px"] >= 0.99
    assert result["light_agreement"] >= 0.995
    assert result["bumper_agreement"] >= 0.97


def test_arena_a_is_the_recorded_one():
    picture = np.load(RECORDING)["arena"]
    drawn = np.zeros_like(picture)
    for x0, y0, x1, y1 in (*arenas.BORDER, *arenas.ARENAS["A"]):
        drawn[y0 : y1 + 1, x0 : x1 + 1] = True
    # The recorded picture has a notch in its lower right corner, behind the border, out of the robot's reach.
    assert (drawn != picture).sum() <= 8 and not (drawn != picture)[:195].any()


def test_rectangles_cover_a_picture_exactly():
    picture = np.random.default_rng(0).random((30, 40)) < 0.4
    drawn = np.zeros_like(picture, int)
    for x0, y0, x1, y1 in geometry.rectangles(picture).astype(int):
        drawn[y0 : y1 + 1, x0 : x1 + 1] += 1
    np.testing.assert_array_equal(drawn, picture)


def test_motion_is_the_exact_arc():
    posture = ball_collecting.Posture(jnp.float32(100), jnp.float32(200), jnp.float32(0.3))
    left, right, radius = 3.0, -1.5, 20.0
    turn = (right - left) / (2 * radius)
    turning_radius = (left + right) / 2 / turn
    moved = ball_collecting.move(posture, left, right, radius)
    expected = (
        100 + turning_radius * (np.sin(0.3 + turn) - np.sin(0.3)),
        200 - turning_radius * (np.cos(0.3 + turn) - np.cos(0.3)),
        0.3 + turn,
    )
    np.testing.assert_allclose(moved, expected, rtol=1e-6)


@pytest.mark.parametrize("name", arenas.ARENAS)
@pytest.mark.parametrize("placement", range(3))
def test_placements_are_free_and_within_reach(name, placement):
    domain = jax.device_get(arenas.arena(name, placement))
    heading = jnp.array([1.0, 0.0])
    for point in (domain.start[:2], *domain.balls, domain.switch):
        assert not touch(domain, point, heading).collision
    # Somewhere in the basket the robot can stand.
    spots = [domain.basket + np.array([dx, dy], np.float32) for dx in range(-35, 36, 5) for dy in range(-35, 36, 5)]
    assert any(not touch(domain, spot, heading).collision for spot in spots)


def test_collecting_a_ball():
    """Pick up, carry, drop in the basket: one reward, and the ball is gone."""
    hold, drop = jnp.array([0.5, 0.5, 1.0]), jnp.array([0.5, 0.5, 0.0])
    ball, basket = ARENA.balls[0], ARENA.basket
    state = step(ARENA, at(ARENA, ball[0] + 19, ball[1], 0.0), hold)
    assert state.carried.tolist() == [True, False, False, False]
    assert state.observation[11] == 1 and state.reward == 0
    state = step(
        ARENA,
        state._replace(posture=ball_collecting.Posture(basket[0] - 49, basket[1], jnp.float32(0))),
        drop,
    )
    assert state.reward == 100 and not state.carried.any() and state.taken[0]
    np.testing.assert_allclose(state.balls[0], [basket[0] - 49, basket[1]])
    assert step(ARENA, state, hold).reward == 0


def test_a_ball_dropped_elsewhere_is_lost():
    ball = ARENA.balls[0]
    state = step(ARENA, at(ARENA, *ball, 0.0), jnp.array([0.5, 0.5, 1.0]))
    state = step(ARENA, state, jnp.array([0.5, 0.5, 0.0]))
    assert state.reward == 0 and state.taken[0] and not state.carried.any()
    state = step(ARENA, state, jnp.array([0.5, 0.5, 1.0]))
    assert not state.carried.any(), "a lost ball cannot be picked up again"


def test_out_of_reach_or_with_the_crane_open_nothing_is_picked_up():
    ball = ARENA.balls[0]
    far = step(ARENA, at(ARENA, ball[0] + 21, ball[1], 0.0), jnp.array([0.5, 0.5, 1.0]))
    open_crane = step(ARENA, at(ARENA, *ball, 0.0), jnp.array([0.5, 0.5, 0.49]))
    assert not far.carried.any() and not open_crane.carried.any()


def test_the_switch_makes_the_other_balls_appear():
    hold = jnp.array([0.5, 0.5, 1.0])
    later = ARENA.balls[2]
    assert not step(ARENA, at(ARENA, *later, 0.0), hold).carried.any()
    pulled = step(ARENA, at(ARENA, *ARENA.switch, 0.0), hold)
    assert pulled.switch_pulled and pulled.observation[12] == 1
    after = pulled._replace(posture=ball_collecting.Posture(*later, jnp.float32(0)))
    assert step(ARENA, after, hold).carried.tolist() == [False, False, True, False]


def test_standing_still_for_more_than_a_hundred_steps_is_being_idle():
    stand, creep = jnp.array([0.5, 0.5, 1.0]), jnp.array([0.5, 0.51, 1.0])
    state = reset(ARENA)
    for _ in range(100):
        state = step(ARENA, state, stand)
    assert not TASK.truncated(state)
    assert TASK.truncated(step(ARENA, state, stand))
    assert not TASK.truncated(step(ARENA, step(ARENA, state, stand), creep))


def test_sensors_stay_in_range_on_a_random_walk():
    domains = arenas.target_domains("B")

    def walk(domain, key):
        def step(state, action):
            state = TASK.step(domain, state, action)
            return state, state.observation

        return jax.lax.scan(step, TASK.reset(None, domain), jax.random.uniform(key, (3000, 3)))

    state, observations = jax.jit(jax.vmap(walk))(domains, jax.random.split(jax.random.key(0), 6))
    assert np.isfinite(observations).all() and observations.min() >= 0 and observations.max() <= 1
    # The body never gets into a wall.
    for domain, posture in zip(range(6), np.stack(state.posture, axis=1), strict=True):
        place = jax.tree.map(lambda leaf, d=domain: leaf[d], domains)
        assert not touch(place, jnp.array(posture[:2]), jnp.array([1.0, 0.0])).collision


def test_the_brax_environment_is_the_task():
    env = BallCollecting("B", 1)
    assert isinstance(env, brax.envs.Env) and env.observation_size == 13 and env.action_size == 3
    domain = arenas.arena("B", 1)
    wrapped = VmapWrapper(EpisodeWrapper(env, 50, 1))
    brax_state = jax.jit(wrapped.reset)(jax.random.split(jax.random.key(0), 2))
    state = reset(domain)
    brax_step = jax.jit(wrapped.step)
    for t in range(50):
        action = jax.random.uniform(jax.random.key(t), (3,))
        with jax.numpy_dtype_promotion("standard"):  # Brax counts steps in floats and in whole numbers
            brax_state = brax_step(brax_state, jnp.stack([action, action]))
        state = step(domain, state, action)
        np.testing.assert_allclose(brax_state.obs[1], state.observation, atol=1e-6)
    assert brax_state.done.tolist() == [1.0, 1.0]  # the wrapper's 50 steps are over
    assert brax_step._cache_size() == 1, "the step was compiled more than once"


@pytest.mark.parametrize(("arena", "placement"), [("D", 0), ("A", 3), ("A", -1), ("", 0)])
def test_unknown_domains_are_named(arena, placement):
    with pytest.raises(ValueError, match="choose"):
        BallCollecting(arena, placement)


def test_parity_command_refuses_what_is_broken_in_one_line(tmp_path, monkeypatch, capsys):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(RECORDING.read_bytes()[:5000])
    for path in (broken, tmp_path / "missing.npz"):
        monkeypatch.setattr(sys, "argv", ["parity.py", "fastsim", str(path)])
        with pytest.raises(SystemExit, match="2"):
            parity.main()
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
