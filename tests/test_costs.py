"""What a study costs: proportions that must hold whatever the rates are, and the dry run's table."""

import re
from dataclasses import replace

import pytest
from conftest import tiny_settings
from toy_tasks import corridor

from qboot import cli
from qboot.envs.registry import get_task
from qboot.study import calibration, costs, dry_run, jobs
from qboot.study.controls.conditions import WHATS, places
from qboot.study.pipeline import profiles

RATES = costs.Costs(
    start=1.0,
    compile_evolution=10.0,
    compile_learning=5.0,
    rollout_step=1e-6,
    acting_step=2e-6,
    update=1e-5,
    weight=1e-10,
    lived=0.5,
    lived_evolving=0.8,
)


@pytest.fixture
def table(tmp_path):
    return jobs.jobs_of("quick", "ball_collecting", tmp_path)


def changed(job, **settings):
    return job._replace(run=replace(job.run, **settings))


def test_evolution_costs_every_step_of_every_rollout(table):
    run = table[0].run
    steps = (2 + run.evolution.generations) * run.evolution.population * 2 * run.n_steps * RATES.lived_evolving
    # A distance is drawn anew after 50 of the 250 generations; each of the four has a program of its own.
    assert costs.seconds_of(table[0], RATES) == {"evolve": pytest.approx(1 + 4 * 10 + steps * 1e-6 * costs.GENERATION)}


def test_learning_costs_steps_and_updates(table):
    job = table[2]
    run = job.run
    steps = 2 * run.n_steps * RATES.lived
    duration = 8 + 92 / 8
    weights = run.actions.n_actions * (costs.SHARE_OF_INPUTS * 8 * 13) * run.learner.hidden
    # Each decision is an update, and each is replayed `eta` times once the store is full.
    updates = steps / duration * (1 + run.learner.eta)
    episode = steps * 2e-6 + updates * (1e-5 + weights * 1e-10)
    assert costs.seconds_of(job, RATES) == {"learn": pytest.approx(1 + 5 + run.episodes * episode)}


def test_a_transfer_reports_three_parts_in_their_order(table):
    job = table[3]
    parts = costs.seconds_of(job, RATES)
    assert list(parts) == ["target_learn", "target_er", "target_er_transfer"]
    least = costs.seconds_of(changed(job, target_generations=1, target_episodes=1), RATES)
    assert all(least[name] < parts[name] for name in parts)


def test_evolution_on_the_target_set_ends_when_the_papers_quarters_had_the_top_score(table):
    """The paper prints 268,160 episodes, quartiles 130,304 to 1,263,360; the first population has twice 128."""
    run = changed(table[3], target_generations=2_500).run
    assert costs.until_top(run, "ER") == (1_016 + 2_093 + 2_500 + 2_500) / 4
    assert costs.until_top(replace(run, target_generations=300), "ER") == 300
    assert costs.until_top(replace(run, evolution=replace(run.evolution, reevaluate=True)), "ER") == 2_500
    assert costs.until_top(replace(run, evolution=replace(run.evolution, algorithm="snes")), "ER") == 2_500


def test_a_control_experiment_costs_as_many_episodes_as_its_learners(table):
    free = RATES._replace(start=0.0, compile_evolution=0.0, compile_learning=0.0, update=0.0, weight=0.0)
    by_what = {job.what: sum(costs.seconds_of(job, free).values()) for job in table if not job.run}
    task = get_task("ball_collecting")
    learners = {what: sum(place.what == what for place in places(task, what).values()) for what in WHATS}
    # Steps of the robot alone, the same for every learner.
    each = {what: by_what[what] / learners[what] for what in by_what}
    assert each["sensors"] == pytest.approx(each["actions"])
    assert each["n_actions"] == pytest.approx(each["actions"])


def test_a_learner_costs_by_its_own_actions_and_inputs(table):
    sensors = next(job for job in table if job.what == "sensors")
    weights = RATES._replace(start=0.0, compile_learning=0.0, acting_step=0.0, update=0.0)
    # Of the 3 learners of each condition: 13 sensors now, 80 % of 104 twice, up to 156; what a human chose is at home
    # in the other experiment. 17 actions of 15 steps each.
    updates = 2 * 4_000 * RATES.lived / 15 * 4
    inputs = 13 + 2 * 0.8 * 104 + 156 / 2
    expected = 3 * 80 * updates * 17 * inputs * 125 * RATES.weight
    assert costs.seconds_of(sensors, weights)["ablate"] == pytest.approx(expected)


def test_the_dry_run_starts_nothing_and_ends_with_the_sum(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(dry_run, "measure", lambda task, n_steps: RATES)
    out = tmp_path / "study"
    assert cli.main(["reproduce", "--dry-run", "--profile", "quick", "--out", str(out)]) == 0
    assert not out.exists()
    lines = capsys.readouterr().out.splitlines()
    last = re.fullmatch(r"(\d+\.\d\d) core-hours", lines[-1])
    assert last
    rows = [line.split() for line in lines[1 : lines.index("")]]
    assert len(rows) == len(jobs.jobs_of("quick", None, out))
    assert sum(float(row[-1]) for row in rows) == pytest.approx(float(last[1]), abs=0.01)
    assert {row[-2] for row in rows} == {"ready", "waits"}
    assert [row[-2] for row in rows if "evolve" in row] == ["ready"] * 4


def test_what_is_done_costs_nothing(tiny_study, tiny_sweep, monkeypatch):
    monkeypatch.setattr(dry_run, "measure", lambda task, n_steps: RATES)
    # A stage or a learner is done when its files were made with the settings that the study asks for.
    monkeypatch.setattr(profiles, "runs_of", lambda name, profile, physics: [tiny_settings()])
    lines = list(dry_run.lines("smoke", "ball_collecting", tiny_study))
    assert [line.split()[-2:] for line in lines[1:8]] == [["done", "0.0000"]] * 7
    assert lines[-1] == "0.00 core-hours"


@pytest.mark.parametrize("lags", [8, 15])
def test_rates_are_measured(lags):
    """On a task whose programs compile in no time; with 15 lags it selects as many inputs as can be measured."""
    task = corridor((0, 3), (5, 2))
    defaults = profiles.defaults_of(task)
    defaults = defaults._replace(sensors=replace(defaults.sensors, lags=lags))
    found = calibration.measure(task._replace(defaults=lambda: defaults), 60)
    assert found.rollout_step > 0 and found.compile_evolution > 0 and found.compile_learning > 0
    assert found.acting_step >= 0 and found.update >= 0
    assert 0 < found.lived <= 1
