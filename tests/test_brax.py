"""Our tasks as Brax and Gymnasium environments, checked against the tasks themselves."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qboot.envs import BallCollecting, BoxPushing, TaskEnv, get_task

ARM = get_task("box_pushing", "kinematic")


def first(domains):
    return jax.tree.map(lambda leaf: leaf[0], domains)


@pytest.mark.parametrize("order", ["import qboot.envs, brax.envs", "import brax.envs, qboot.envs"])
def test_our_environments_are_in_braxs_registry(order):
    code = f"""{order}
arm = brax.envs.get_environment("qboot_box_pushing", size=5, physics="kinematic")
robot = brax.envs.get_environment("qboot_ball_collecting", arena="B", action_range=(-1, 1))
assert (arm.dt, arm.action_size, robot.action_range) == (0.01, 3, (-1.0, 1.0))
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_tasks_can_be_looked_for_without_loading_brax():
    code = "import sys, qboot.envs; qboot.envs.names(); assert not {'brax', 'jax', 'gymnasium'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("action_range", [(0.0, 1.0), (-1.0, 1.0), (2.0, 6.0)])
def test_actions_are_scaled_clipped_and_never_nan(action_range):
    low, high = action_range
    env = BoxPushing(physics="kinematic", action_range=action_range)
    state = env.reset(jax.random.key(0))
    step = jax.jit(env.step)
    pairs = [
        ([low, high, (low + high) / 2], [0.0, 1.0, 0.5]),
        ([low - 9, high + 9, np.inf], [0.0, 1.0, 1.0]),
        ([np.nan, low + 0.25 * (high - low), np.nan], [0.5, 0.25, 0.5]),
    ]
    for action, command in pairs:
        expected = ARM.step(env.domain, state.pipeline_state, jnp.array(command))
        after = step(state, jnp.array(action))
        np.testing.assert_allclose(after.obs, expected.observation, atol=1e-6)


def test_commands_in_range_are_obeyed_to_the_bit():
    env = BallCollecting()
    actions = jax.random.uniform(jax.random.key(0), (100, 3))
    np.testing.assert_array_equal(jax.vmap(env.commands)(actions), actions)


def test_every_domain_is_drawn_and_kept_through_a_rollout():
    env = BallCollecting(domains="target", source="A")
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 60))
    assert set(np.asarray(states.info["domain"]).tolist()) == set(range(6))
    after = jax.jit(jax.vmap(env.step))(states, jnp.ones((60, 3)))
    reset, step = jax.jit(env.task.reset), jax.jit(env.task.step)
    np.testing.assert_array_equal(after.info["domain"], states.info["domain"])
    for place in range(6):
        lane = int(np.argmax(np.asarray(states.info["domain"]) == place))
        domain = jax.tree.map(lambda leaf, place=place: leaf[place], env.domains)
        alone = step(domain, reset(jax.random.key(1), domain), jnp.ones(3))
        np.testing.assert_allclose(after.obs[lane], alone.observation, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "either one domain or domains"),
        ({"domain": first(ARM.source_domains("A")), "domains": "source"}, "either one domain or domains"),
        ({"domains": "elsewhere"}, "must be source or target"),
        ({"domains": "source", "source": "Z"}, "unknown source 'Z'"),
        ({"domain": first(ARM.source_domains("A")), "source": "A"}, "source is 'A', but belongs to domains="),
        ({"domains": "source", "action_range": (1.0, 1.0)}, "low below high"),
    ],
)
def test_what_makes_no_environment_is_named(arguments, words):
    with pytest.raises(ValueError, match=words):
        TaskEnv(ARM, **arguments)


def test_braxs_wrapper_marks_the_end_of_an_episode_as_truncated():
    from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper

    env = AutoResetWrapper(EpisodeWrapper(BallCollecting(domains="source"), episode_length=3, action_repeat=1))
    state = jax.jit(env.reset)(jax.random.key(0))
    step = jax.jit(env.step)
    for t in range(1, 4):
        with jax.numpy_dtype_promotion("standard"):  # Brax counts steps in floats and in whole numbers
            state = step(state, jnp.ones(3))
        assert (float(state.done), float(state.info["truncation"])) == (float(t == 3), float(t == 3))
    np.testing.assert_array_equal(state.obs, state.info["first_obs"])


def test_a_picture_shows_the_robot_where_it_is():
    env = BallCollecting()
    state = env.reset(jax.random.key(0))
    states = [state]
    for _ in range(15):
        states.append(env.step(states[-1], jnp.ones(3)))
    pictures = [env.render(state, 120, 160), env.render(states[-1], 120, 160), env.render(states, 120, 160)]
    for picture in pictures:
        assert (picture.shape, picture.dtype) == ((120, 160, 3), np.uint8)
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5
    assert (pictures[0] != pictures[1]).any() and (pictures[1] != pictures[2]).any()
    with pytest.raises(ValueError, match="does not say how it is drawn"):
        TaskEnv(env.task._replace(view=None), env.domain).render(state)


@pytest.mark.parametrize("name", ["ball_collecting", "box_pushing"])
@pytest.mark.filterwarnings("ignore:.*WARN")  # it recommends gymnasium.make, which is for registered environments
def test_gymnasiums_checker_is_content(name):
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    from qboot.envs import GymnasiumEnv

    task = get_task(name, {"box_pushing": "kinematic"}.get(name))
    checker.check_env(GymnasiumEnv(task, action_range=(-1.0, 1.0), render_mode="rgb_array"), skip_render_check=False)


def test_a_gymnasium_rollout_is_the_tasks():
    pytest.importorskip("gymnasium")
    from qboot.envs import GymnasiumEnv

    env = GymnasiumEnv(ARM._replace(max_steps=4), domains="target")
    first_observation, info = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    np.testing.assert_array_equal(first_observation, again)
    assert info["domain"] in range(3)
    for t in range(1, 5):
        observation, reward, terminated, truncated, _ = env.step(np.full(3, 0.5, np.float32))
        assert env.observation_space.contains(observation)
        assert (reward, terminated, truncated) == (0.0, False, t == 4)
    still = GymnasiumEnv(get_task("ball_collecting"), domain=BallCollecting().domain)
    still.reset(seed=0)
    cut = [still.step(np.full(3, 0.5, np.float32))[3] for _ in range(101)]
    assert cut == [False] * 100 + [True]
    with pytest.raises(ValueError, match="render_mode is 'human'"):
        GymnasiumEnv(ARM, render_mode="human")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["qboot_ball_collecting", "qboot_box_pushing"])
@pytest.mark.filterwarnings("ignore")  # of the learner's own libraries
def test_braxs_ppo_trains(name):
    import brax.envs
    from brax.training.agents.ppo import networks, train

    from qboot.envs import brax_learners

    brax_learners.mend()

    physics = {"physics": "kinematic"} if name == "qboot_box_pushing" else {}
    env = brax.envs.get_environment(name, domains="source", action_range=(-1.0, 1.0), **physics)
    seen = []
    with jax.numpy_dtype_promotion("standard"):  # Brax's learner mixes kinds of numbers
        make_policy, parameters, _ = train.train(
            env,
            num_timesteps=4096,
            episode_length=64,
            num_envs=16,
            num_eval_envs=16,
            num_evals=2,
            batch_size=16,
            num_minibatches=4,
            unroll_length=16,
            num_updates_per_batch=2,
            network_factory=lambda *sizes, **options: networks.make_ppo_networks(
                *sizes, policy_hidden_layer_sizes=(16,), value_hidden_layer_sizes=(16,), **options
            ),
            progress_fn=lambda steps, metrics: seen.append((steps, metrics["eval/episode_reward"])),
        )
    assert seen[-1][0] >= 4096 and np.isfinite([reward for _, reward in seen]).all()
    action, _ = make_policy(parameters)(env.reset(jax.random.key(0)).obs, jax.random.key(1))
    assert action.shape == (3,) and np.isfinite(action).all()
