"""Box pushing: the rules, the two physics, and the recorded runs of the original arm."""

import json
import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import agreement, parity
from qboot.envs import BoxPushing
from qboot.envs.box_pushing import arm, on_physics, physics_kinematic, physics_mjx
from qboot.envs.box_pushing import domains as blocks
from qboot.envs.box_pushing import dynamics as box_pushing
from qboot.neuroevolution.dnn import DnnSettings, Genome

DATA = Path(__file__).parent / "data"
PHYSICS = ("mjx", "kinematic")
SMALL = blocks.block(1.0)
NEUTRAL = jnp.array([0.5, 0.5, 0.5])


def compiled_step(physics):
    return jax.jit(jax.vmap(on_physics(physics).step))


step_of = {physics: compiled_step(physics) for physics in PHYSICS}


def pushed(physics, offsets, command=(0.5, 1.0, 0.5)):
    """States after one step from hands at `offsets` (N, 3) of the smallest block."""
    block = jnp.array([0.3, -0.1, blocks.TABLE_TOP + SMALL.half_size[2]])
    hands = block + jnp.asarray(offsets, jnp.float32)
    n = len(offsets)
    domains = jax.tree.map(lambda leaf: jnp.tile(leaf, (n, 1)), SMALL)
    states = jax.vmap(partial(box_pushing.state_at, block=block))(domains, hands)
    return step_of[physics](domains, states, jnp.tile(jnp.array(command), (n, 1)))


# One batch, so that MJX is compiled once: offset of the hand, contact with the block, success.
REACH_X, REACH_Y, REACH_Z = (float(x) for x in SMALL.half_size + arm.HALF_SIZE)
CASES = [
    ((0.0, REACH_Y - 0.005, 0.0), True, True),
    ((0.015, REACH_Y - 0.005, 0.0), True, True),
    ((-0.019, REACH_Y - 0.005, 0.0), True, True),
    ((0.0, REACH_Y - 0.005, 0.019), True, True),
    ((0.021, REACH_Y - 0.005, 0.0), True, False),
    ((-0.03, REACH_Y - 0.005, 0.0), True, False),
    ((0.015, REACH_Y - 0.005, 0.015), True, False),
    ((0.0, -REACH_Y + 0.005, 0.0), True, False),  # the left face
    ((REACH_X - 0.005, 0.0, 0.0), True, False),
    ((-REACH_X + 0.005, 0.0, 0.0), True, False),
    ((0.0, 0.0, REACH_Z - 0.005), True, False),  # from above
    ((0.0, REACH_Y + 0.001, 0.0), False, False),  # the step that makes them overlap does not see it yet
    ((0.0, REACH_Y + 0.1, 0.0), False, False),
]


@pytest.mark.parametrize("physics", PHYSICS)
def test_first_contact_decides(physics):
    offsets, touching, success = zip(*CASES, strict=True)
    states = pushed(physics, offsets)
    np.testing.assert_array_equal(states.done, touching)
    np.testing.assert_array_equal(states.reward, np.where(success, 10.0, 0.0))
    shift = np.asarray(states.travelled[:, 3:])
    assert (shift[np.array(success), 1] > 0.005).all() and (shift[:, 2] == 0).all()
    assert (shift[~np.array(touching)] == 0).all()


def test_both_physics_move_the_block_alike():
    offsets = [case[0] for case in CASES]
    mjx, kinematic = (pushed(physics, offsets) for physics in PHYSICS)
    np.testing.assert_allclose(mjx.travelled, kinematic.travelled, atol=2e-7)
    np.testing.assert_allclose(mjx.block, kinematic.block, atol=2e-7)


@pytest.mark.parametrize("n_states", [6_000, pytest.param(200_000, marks=pytest.mark.slow)])
def test_the_closed_form_is_the_step_of_mujoco(n_states):
    """From states apart, in contact, and within a few millimetres of it, edges and corners included."""
    widths = blocks.SOURCE_WIDTHS + blocks.TARGET_WIDTHS
    domain = jax.tree.map(lambda leaf: jnp.resize(leaf, (n_states, 3)), blocks.stacked(widths))
    keys = jax.random.split(jax.random.key(1), 5)
    block = jax.random.uniform(keys[0], (n_states, 2), minval=blocks.BLOCK_LOW, maxval=blocks.BLOCK_HIGH)
    block = jnp.concatenate([block, blocks.TABLE_TOP + domain.half_size[:, 2:]], axis=1)
    reach = domain.half_size + arm.HALF_SIZE
    offset = jax.random.uniform(keys[1], (n_states, 3), minval=-1.0, maxval=1.0) * (reach + 0.01)
    at_edge = jnp.sign(offset) * (reach - jax.random.uniform(keys[2], (n_states, 3), maxval=0.003))
    offset = jnp.where(jax.random.bernoulli(keys[4], 0.3, (n_states, 3)), at_edge, offset)
    command = jax.random.uniform(keys[3], (n_states, 3))

    mjx, kinematic = (
        jax.tree.map(np.asarray, jax.jit(jax.vmap(physics.move))(domain, block + offset, block, command))
        for physics in (physics_mjx, physics_kinematic)
    )
    touching = mjx.touching & kinematic.touching
    assert 0.2 < touching.mean() < 0.8
    # Where the tip's surface is within rounding of the block's, either answer is right.
    assert (mjx.touching != kinematic.touching).sum() <= n_states // 50_000
    # Beyond an edge MuJoCo's normal comes from a nearest point that is rounded.
    normal_error = np.abs(mjx.normal - kinematic.normal).max(axis=1)
    on_face = np.abs(kinematic.normal).max(axis=1) == 1.0
    np.testing.assert_allclose(normal_error[touching & on_face], 0.0, atol=1e-6)
    assert (normal_error[touching] < 1e-2).mean() > 0.99
    alike = (mjx.touching == kinematic.touching) & (~touching | (normal_error < 1e-6))
    np.testing.assert_allclose(mjx.hand[alike], kinematic.hand[alike], atol=2e-7)
    np.testing.assert_allclose(mjx.block[alike], kinematic.block[alike], atol=2e-7)


@pytest.mark.parametrize("physics", PHYSICS)
def test_finished_test_is_absorbing(physics):
    offsets = [case[0] for case in CASES]
    once = pushed(physics, offsets)
    domains = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(CASES), 1)), SMALL)
    twice = step_of[physics](domains, once, jnp.tile(NEUTRAL, (len(CASES), 1)))
    done = np.asarray(once.done)
    for before, after in zip(once._replace(reward=jnp.zeros(len(CASES))), twice, strict=True):
        np.testing.assert_array_equal(np.asarray(before)[done], np.asarray(after)[done])


def test_stops_let_nothing_out():
    hand = jnp.array([0.61, -0.35, 0.77])
    blocked = arm.admissible(hand, jnp.array([0.0, 1.0, 1.0]))
    np.testing.assert_array_equal(blocked, [0.5, 0.5, 1.0])
    inwards = jnp.array([1.0, 0.0, 0.0])
    np.testing.assert_array_equal(arm.admissible(hand, inwards), inwards)


def test_model_has_the_constants_of_the_arm():
    model = physics_mjx.model()[0]
    assert model.opt.timestep == arm.TIME_STEP
    np.testing.assert_allclose(model.body_subtreemass[[3, 2, 1]], arm.MOVED_MASS)
    np.testing.assert_allclose(model.actuator_gear[:, 0], -arm.FORCE)
    np.testing.assert_allclose(model.geom("hand").size, arm.HALF_SIZE)
    assert model.pair_solimp[0, 0] == physics_kinematic.SHARE_OF_ADVANCE
    np.testing.assert_allclose(-model.pair_solref[0, 0] * arm.TIME_STEP**2, physics_kinematic.SHARE_OF_OVERLAP)
    assert model.geom("tip").size[0] == physics_kinematic.TIP
    assert model.body_mass[-1] == physics_kinematic.BLOCK_MASS
    np.testing.assert_allclose(model.body_invweight0[-2:, 0].sum(), physics_kinematic.MEAN_INVERSE_MASS)


def test_starts():
    keys = jax.random.split(jax.random.key(0), 2000)
    largest = blocks.block(3.0)
    states = jax.vmap(lambda key: box_pushing.reset(key, largest))(keys)
    depths = jax.vmap(partial(blocks.overlap_depths, largest))(states.hand, states.block)
    assert (np.asarray(depths).min(axis=1) < 0).all()
    assert (states.hand >= blocks.HAND_LOW).all() and (states.hand <= blocks.HAND_HIGH).all()
    places = states.block[:, :2]
    assert (places >= blocks.BLOCK_LOW).all() and (places <= blocks.BLOCK_HIGH).all()
    np.testing.assert_allclose(states.block[:, 2] - largest.half_size[2], blocks.TABLE_TOP, rtol=1e-6)
    room_to_push = arm.STOP_HIGH[1] - arm.HALF_SIZE[1] - largest.half_size[1]
    assert states.block[:, 1].max() < room_to_push


def test_domain_sets():
    task = on_physics("mjx")
    source, target = task.source_domains("A").half_size, task.target_domains("A").half_size
    assert source.shape == target.shape == (3, 3)
    np.testing.assert_allclose(2 * source[:, 0], [0.05, 0.07, 0.09], rtol=1e-6)
    np.testing.assert_allclose(2 * source[:, 2], [0.05, 0.06, 0.07], rtol=1e-6)
    assert not np.isin(np.asarray(target[:, 2]), np.asarray(source[:, 2])).any()
    assert not np.isin(np.asarray(target[:, 0]), np.asarray(source[:, 0])).any()
    for domains in (task.source_domains, task.target_domains):
        with pytest.raises(ValueError, match="unknown source 'B'"):
            domains("B")


def test_position_is_a_cell_of_the_grid():
    block = jnp.array([0.3, -0.1, 0.715])
    corners = [arm.REACH_LOW - 0.1, arm.REACH_LOW + 0.001, arm.REACH_HIGH - 0.001, arm.REACH_HIGH + 0.1]
    states = [box_pushing.state_at(SMALL, jnp.asarray(corner), block) for corner in corners]
    assert [int(box_pushing.position(SMALL, state)) for state in states] == [0, 0, 143, 143]


def test_outcome_is_the_distance_travelled():
    state = box_pushing.state_at(SMALL, jnp.array([0.4, 0.0, 0.8]), jnp.array([0.3, -0.2, 0.715]))
    task = on_physics("kinematic")
    for x in (0.0, 1.0):  # there and back
        state = task.step(SMALL, state, jnp.array([x, 0.5, 0.5]))
    np.testing.assert_allclose(task.outcome(SMALL, state), [0.05, 0, 0, 0, 0, 0], atol=1e-6)


@pytest.mark.parametrize("physics", ["kinematic", pytest.param("mjx", marks=pytest.mark.slow)])
def test_brax_environment(physics):
    env = BoxPushing(size=1, physics=physics)
    assert (env.observation_size, env.action_size, env.backend) == (13, 3, physics)
    first = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), 4))

    def step(state, key):
        state = jax.vmap(env.step)(state, jax.random.uniform(key, (4, 3)))
        return state, state.obs

    last, observations = jax.jit(partial(jax.lax.scan, step))(first, jax.random.split(jax.random.key(1), 50))
    assert observations.shape == (50, 4, 13)
    assert last.obs.dtype == last.reward.dtype == last.done.dtype == jnp.float32
    assert ((observations >= 0) & (observations <= 1)).all()


def test_unknown_choices_are_refused():
    with pytest.raises(ValueError, match="unknown block size 6"):
        BoxPushing(size=6)
    with pytest.raises(ValueError, match="unknown physics 'ode'"):
        BoxPushing(physics="ode")


def reflexes(domain, state, weights):
    """A random controller: one layer from the sensors to the commands; `weights` (14, 3)."""
    return jax.nn.sigmoid(5.0 * (state.observation @ weights[:-1] + weights[-1]))


def steering(domain, state, aim):
    """A controller that goes over the block to its right, aims off its centre by `aim` (3,), and pushes."""
    room = arm.HALF_SIZE + domain.half_size + 0.01
    x, y, z = state.hand
    block_x, block_y, block_z = state.block
    is_right = y > block_y + room[1]
    is_above = z > block_z + room[2]
    over = jnp.where(is_above, jnp.stack([x, block_y + room[1] + 0.03, z]), jnp.stack([x, y, 0.82]))
    beside = jnp.stack([block_x, y, block_z]) + aim * jnp.array([1.0, 0.0, 1.0])
    goal = jnp.where(is_right, beside, over)
    is_aligned = is_right & (jnp.abs(goal - state.hand).max() < 0.005)
    command = jnp.clip(0.5 + (goal - state.hand) / arm.STEP_PER_COMMAND, 0.0, 1.0)
    return command.at[1].set(jnp.where(is_aligned, 1.0, command[1]))


def outcomes(physics, seed, n_tests):
    """Whether each of N tests ended and succeeded, (2, N); half the controllers are random, half steer."""
    task = on_physics(physics)

    def run(key, index):
        domain = jax.tree.map(lambda leaf: leaf[index % 3], task.source_domains("A"))
        start_key, weight_key, aim_key, noise_key = jax.random.split(key, 4)
        weights = jax.random.uniform(weight_key, (14, 3), minval=-5.0, maxval=5.0)
        aim = jax.random.uniform(aim_key, (3,), minval=-0.03, maxval=0.03)
        steers = index % 2 == 0

        def step(carry, t):
            state, score = carry
            command = jnp.where(steers, steering(domain, state, aim), reflexes(domain, state, weights))
            noise = 0.1 * jax.random.normal(jax.random.fold_in(noise_key, t), (3,))
            state = task.step(domain, state, jnp.clip(command + noise, 0.0, 1.0))
            return (state, score + state.reward), None

        start = task.reset(start_key, domain), jnp.float32(0.0)
        (state, score), _ = jax.lax.scan(step, start, jnp.arange(task.max_steps))
        return jnp.stack([state.done, score > 0])

    keys = jax.random.split(jax.random.key(seed), n_tests)
    return np.asarray(jax.jit(jax.vmap(run, out_axes=1))(keys, jnp.arange(n_tests)))


@pytest.mark.parametrize("n_tests", [600, pytest.param(12_000, marks=pytest.mark.slow)])
def test_both_physics_agree(n_tests):
    mjx, kinematic = (outcomes(physics, 0, n_tests) for physics in PHYSICS)
    assert (mjx == kinematic).all()
    ended, succeeded = mjx.mean(axis=1)
    assert succeeded > 0.1 and ended - succeeded > 0.1  # both outcomes are well represented


@pytest.mark.slow
@pytest.mark.parametrize("evolved_in", PHYSICS)
def test_evolved_networks_score_the_same_in_both_physics(evolved_in):
    """Every twelfth network of three lineages of 400 generations: more than 10,000 tests in both cases together."""
    with np.load(DATA / "evolved_arms.npz") as arrays:
        genomes = Genome(*(arrays[f"{evolved_in}.{name}"] for name in Genome._fields))
    for seed in range(12):
        found = agreement.agreement(genomes, DnnSettings(feed_forward=True), seed)
        assert found["rollouts"] == 15 * len(genomes.weights) >= 450
        # A contact within rounding of the threshold may end otherwise: 1 of the first 40,800 of these rollouts.
        assert found["different"] <= 1
        assert found["largest_score_difference"] <= 1
        assert 3 < found["score_mjx"] < 12  # pushes and failures are well represented


@pytest.mark.slow
def test_ten_million_random_steps_are_finite():
    task, n_lanes, n_steps = on_physics("mjx"), 2000, 5000
    domains = jax.tree.map(lambda leaf: jnp.resize(leaf, (n_lanes, 3)), task.source_domains("A"))
    start = jax.vmap(task.reset)(jax.random.split(jax.random.key(0), n_lanes), domains)

    def step(carry, key):
        states, finite, n_contacts = carry
        states = jax.vmap(task.step)(domains, states, jax.random.uniform(key, (n_lanes, 3)))
        finite &= jnp.all(jnp.array([jnp.isfinite(leaf).all() for leaf in states]))
        n_contacts += states.done.sum()
        # A finished test goes on with its block put back, so that contacts of every depth keep occurring.
        return (states._replace(done=jnp.zeros(n_lanes, bool), block=start.block), finite, n_contacts), None

    keys = jax.random.split(jax.random.key(1), n_steps)
    (_, finite, n_contacts), _ = jax.jit(partial(jax.lax.scan, step))((start, jnp.array(True), jnp.int32(0)), keys)
    assert finite
    assert n_contacts > 10_000


@pytest.mark.parametrize("name", ["arm_pushes", "arm_random_commands"])
def test_parity_with_recorded_runs(name):
    report = parity.arm(parity.load(DATA / f"{name}.npz"))
    assert report["free_steps"] > 100
    assert report["free_step_error_p95"] <= 2e-4
    assert report["outcome_agreement"] >= 0.98
    assert report["sensor_error_p95"] is None or report["sensor_error_p95"] <= 0.01


def test_blocks_shift_as_recorded():
    tests = parity.pushes(parity.load(DATA / "arm_pushes.npz"))
    state = parity.one_step(tests)
    # The step of the recorded contact, where we see it as well: boxes at distance zero may touch or not.
    first = tests.contact & (np.cumsum(tests.contact, axis=1) == 1)
    contact = first & tests.success & state.done
    assert contact.sum() >= 8
    recorded, ours = ((block - tests.block)[contact][:, 1] for block in (tests.next_block, state.block))
    np.testing.assert_allclose(ours, recorded, atol=0.002)


def test_parity_command_refuses_other_files(tmp_path, monkeypatch, capsys):
    wrong = tmp_path / "wrong.npz"
    np.savez(wrong, commands=np.zeros((1, 2, 3)))
    for file, message in ((tmp_path / "none.npz", "no .npz file"), (wrong, "lacks")):
        monkeypatch.setattr(sys, "argv", ["parity.py", "arm", str(file)])
        with pytest.raises(SystemExit, match="2"):
            parity.main()
        said = capsys.readouterr()
        assert message in said.err and said.err.count("\n") == 1 and said.out == ""


def test_parity_command_prints_one_object(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["parity.py", "arm", str(DATA / "arm_random_commands.npz")])
    parity.main()
    assert json.loads(capsys.readouterr().out)["tests"] == 17
