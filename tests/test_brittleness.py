"""The experiment on brittle policies: what its variants change, and that it is told from what is finished."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

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


def test_without_exploration_a_policy_scores_what_it_does_greedily(tiny_run):
    task = task_of(tiny_run)
    problem = problem_on(tiny_run, task.source_domains("A"))
    networks = problem.new_networks(jax.random.key(1))
    apart = brittleness.with_crane_apart(problem)
    assert apart.n_actions == problem.n_actions + 1
    crane = np.asarray(apart.actions.intercepts)[:, 2]
    assert (crane[:-1] == 1.0).all() and crane[-1] == 0.0
    # A task whose every step is rewarded tells policies apart that would score nothing.
    rewarding = task._replace(step=lambda *some: task.step(*some)._replace(reward=some[2][0] * task.reward))
    for each, own in ((problem, networks), (apart, apart.new_networks(jax.random.key(1)))):
        each = dataclasses.replace(each, task=rewarding)
        greedy = qlearning.evaluate(own, jax.random.key(0), each).sum()
        found = brittleness.scores_of(own, jax.random.key(0), each, jnp.float32(0.0), 2)
        np.testing.assert_allclose(found, float(greedy), rtol=1e-6)
    random = brittleness.scores_of(own, jax.random.key(0), each, jnp.float32(1.0), 2)
    assert random[0] != random[1]


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
