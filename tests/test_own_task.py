"""A task that the package knows nothing of goes through the whole method, from a test file to a report."""

import re
import sys
from dataclasses import replace

import jax.numpy as jnp
import pytest
from toy_tasks import RANDOM, corridor

from qboot import envs
from qboot.cli import main
from qboot.envs import registry
from qboot.study.controls import cells, sweep
from qboot.study.controls.conditions import WHATS, conditions
from qboot.study.pipeline import profiles
from qboot.study.pipeline.table import STAGES
from qboot.study.report import page
from qboot.study.store import runs

# Starts are drawn at random, so that some rollouts are long whatever evolved.
TASK = corridor((5, RANDOM), (0, RANDOM), max_steps=40, rollouts_per_domain=4)


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})
    return envs.register(TASK)


def tiny(settings):
    evolution = replace(settings.evolution, population=8, generations=3)
    return replace(settings, evolution=evolution)


@pytest.mark.filterwarnings("ignore:only .* of the .* extracted actions are distinct")
def test_a_registered_task_goes_from_sensors_to_a_report(registered, tmp_path):
    run = runs.create(tmp_path / "corridor" / "A-0", tiny(profiles.settings_of("corridor", "smoke", "A", 0)))
    for stage in STAGES:
        stage.do(run)
        assert stage.is_done(run)
    for what in WHATS:
        begun = cells.begin(cells.plan(tmp_path, "corridor", what, "smoke", n_runs=1, n_episodes=2, lanes=1))
        # Nobody designed actions or sensors for it: what is human-designed is left out.
        assert "human" not in {cell.settings.condition for cell in begun}
        sweep.learn_cells(begun, workers=1)
        assert list(cells.find(tmp_path, "corridor", what)) == list(conditions(TASK, what))
    text = page.write(tmp_path).read_text()
    assert "corridor" in text
    assert not re.search(r"<tbody>\s*</tbody>", text)  # no empty tables


@pytest.mark.filterwarnings("ignore:only .* of the .* extracted actions are distinct")
def test_the_command_line_takes_a_task_from_a_file(tmp_path, monkeypatch, capsys):
    path = tmp_path / "my_robot.py"
    path.write_text(
        "from toy_tasks import RANDOM, corridor\n"
        "MINE = corridor((5, RANDOM), (0, RANDOM), max_steps=40, rollouts_per_domain=4)._replace(name='mine')\n"
    )
    monkeypatch.chdir(tmp_path)
    sizes = [
        "--evolution.population",
        "8",
        "--evolution.generations",
        "2",
        "--actions.n-actions",
        "3",
        "--sensors.lags",
        "2",
    ]
    assert main(["evolve", "--task", "my_robot.py:MINE", "--profile", "smoke", "--out", "run", *sizes]) == 0
    monkeypatch.chdir("/")  # the run remembers where its task is
    for stage in ("extract", "learn", "transfer"):
        assert main([stage, "--out", str(tmp_path / "run")]) == 0
    assert main(["evolve", "--task", "my_robot.py:MINE", "--profile", "smoke"]) == 2
    assert "there is no file my_robot.py" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:only . of the . extracted actions are distinct")
def test_forty_sensors_and_fractions_of_a_reward(monkeypatch, tmp_path):
    def observed(state):
        more = jnp.stack([jnp.sin(state.where.astype(jnp.float32) * (i + 1.0)) / 2 + 0.5 for i in range(33)])
        return state._replace(observation=jnp.concatenate([state.observation, more]), reward=state.reward * 0.037)

    forty = TASK._replace(
        name="forty",
        sensors=tuple(f"sensor {i}" for i in range(40)),
        reset=lambda key, domain: observed(TASK.reset(key, domain)),
        step=lambda domain, state, command: observed(TASK.step(domain, state, command)),
    )
    monkeypatch.setattr(registry, "_registered", {})
    envs.register(forty)
    settings = tiny(profiles.settings_of("forty", "smoke", "A", 0))
    assert settings.dnn.n_inputs == 40
    run = runs.create(tmp_path / "forty" / "A-0", settings)
    for stage in STAGES:
        stage.do(run)
    assert not re.search(r"<tbody>\s*</tbody>", page.write(tmp_path).read_text())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("flying", "unknown task 'flying': choose one of ball_collecting"),
        ("nowhere.module:TASK", "cannot import nowhere.module"),
        ("toy_tasks:CELLS", "has no qboot Task named 'CELLS'"),
        ("toy_tasks:NOTHING", "has no qboot Task named 'NOTHING'"),
    ],
)
def test_a_task_that_cannot_be_found_is_named(name, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        envs.get_task(name)


def test_a_module_brings_a_task(monkeypatch, tmp_path):
    (tmp_path / "brought.py").write_text("from toy_tasks import corridor\nTASK = corridor((5, 2))\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert envs.get_task("brought:TASK").name == "corridor"
    assert "brought" in sys.modules


def test_names_are_taken_once(registered):
    assert envs.register(TASK) is TASK
    with pytest.raises(ValueError, match="there is a task 'corridor' already"):
        envs.register(TASK._replace(max_steps=7))
    with pytest.raises(ValueError, match="there is a task 'ball_collecting' already"):
        envs.register(TASK._replace(name="ball_collecting"))
    with pytest.raises(ValueError, match="names a folder"):
        envs.register(TASK._replace(name="../up"))
    assert "corridor" in envs.names()
