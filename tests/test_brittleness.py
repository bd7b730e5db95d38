"""The experiment on brittle policies: what its variants change, and that it is told from what is finished."""

import jax
import jax.numpy as jnp
import numpy as np
from toy_tasks import corridor, problem

from experiments import brittleness
from qboot import qlearning
from qboot.envs import get_task
from qboot.study.pipeline.learning import problem_on
from qboot.study.store.artifacts import task_of

BALL = get_task("ball_collecting")


def test_noise_is_small_new_in_each_step_and_hides_nothing_else():
    domain = jax.tree.map(lambda leaf: leaf[0], BALL.source_domains("A"))
    noisy = brittleness.with_noise_on_sensors(BALL)
    state, plain = noisy.reset(jax.random.key(0), domain), BALL.reset(jax.random.key(0), domain)
    seen = []
    for _ in range(3):
        command = jnp.array([1.0, 0.9, 1.0])
        state, plain = noisy.step(domain, state, command), BALL.step(domain, plain, command)
        seen.append(np.asarray(state.observation - plain.observation))
        assert 0 < np.abs(seen[-1]).max() < 5 * brittleness.OF_SENSORS
        assert (state.observation >= 0).all() and (state.observation <= 1).all()
    assert (seen[0] != seen[1]).any() and (seen[1] != seen[2]).any()
    jax.tree.map(np.testing.assert_array_equal, state.state, plain)
    moved = [brittleness.with_noise_on_starts(BALL).reset(jax.random.key(i), domain) for i in range(2)]
    places = np.array([[*each.posture] for each in moved])
    assert (places[0] != places[1]).all()
    assert (np.abs(places - np.asarray(domain.start)) <= [5.0, 5.0, 0.1 + 1e-6]).all()


def test_one_action_alone_opens_the_crane(tiny_run):
    whole = problem_on(tiny_run, task_of(tiny_run).source_domains("A"))
    apart = brittleness.with_crane_apart(whole)
    assert apart.n_actions == whole.n_actions + 1
    crane = np.asarray(apart.actions.intercepts)[:, 2]
    assert (crane[:-1] == 1.0).all() and crane[-1] == 0.0
    assert (np.asarray(apart.actions.slopes)[:, 2] == 0.0).all()
    for kept, new in zip(whole.actions, apart.actions, strict=True):
        np.testing.assert_array_equal(np.asarray(kept).T[:2], np.asarray(new)[:-1].T[:2])  # the wheels, or durations


def test_without_exploration_a_policy_scores_what_it_does_greedily():
    robot = corridor((5, 0), (0, 4), (5, 3), max_steps=12)
    some = problem(robot._replace(step=lambda *step: robot.step(*step)._replace(reward=step[2][0] * robot.reward)))
    networks = some.new_networks(jax.random.key(1))
    greedy = float(qlearning.evaluate(networks, jax.random.key(0), some).sum())
    found = brittleness.scores_of(networks, jax.random.key(0), some, jnp.float32(0.0), 2)
    np.testing.assert_allclose(found, greedy, rtol=1e-6)
    random = brittleness.scores_of(networks, jax.random.key(0), some, jnp.float32(1.0), 4)
    assert len(set(random.tolist())) > 1


def test_it_goes_on_where_it_was(tiny_run, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(brittleness, "TRIALS", 1)
    arguments = [str(tmp_path / "out"), str(tiny_run.folder), "--episodes", "2", "--only", "noise on the st"]
    assert brittleness.main(arguments) == 0
    once = (tmp_path / "out" / "scores.csv").read_bytes()
    assert brittleness.main(arguments) == 0
    assert (tmp_path / "out" / "scores.csv").read_bytes() == once
    assert len(once.splitlines()) == 1 + 2 * len(brittleness.EXPLORATION)
    assert "| noise on the starts | 0" in capsys.readouterr().out
    assert brittleness.main([*arguments[:3], "3"]) == 2
    assert "holds learners of 2 episodes" in capsys.readouterr().err
