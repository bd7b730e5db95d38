"""The files in examples/ go through the whole method by command line, as docs/own_robot.md says, at a tiny size."""

import re
from pathlib import Path

import jax
import pytest

from qboot.cli import main
from qboot.envs import get_task

EXAMPLES = Path(__file__).parents[1] / "examples"
TINY = ["--evolution.population", "8", "--evolution.generations", "2", "--actions.n-actions", "3", "--n-steps", "30"]
TINY += ["--sensors.lags", "2"]  # a tiny population may solve the reacher at once: its rollouts are short


@pytest.fixture
def as_brax_needs_it():
    """Brax multiplies truth values by floats; in all threads, which a context would not reach."""
    before = jax.config.jax_numpy_dtype_promotion
    jax.config.update("jax_numpy_dtype_promotion", "standard")
    yield
    jax.config.update("jax_numpy_dtype_promotion", before)


@pytest.mark.usefixtures("as_brax_needs_it")
@pytest.mark.parametrize("name", ["point_robot", pytest.param("reacher", marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:only . of the . extracted actions are distinct")
def test_an_example_goes_from_sensors_to_a_report(name, tmp_path, capsys):
    run = tmp_path / name / "A-0"
    task = f"{EXAMPLES / name}.py:TASK"
    assert main(["evolve", "--task", task, "--profile", "smoke", "--out", str(run), *TINY]) == 0
    for stage in ("extract", "learn", "transfer", "replay"):
        assert main([stage, "--out", str(run)]) == 0
    assert main(["ablate", "--task", task, "--what", "actions", "--profile", "smoke", "--runs", "1", "--episodes", "2",
                 "--out", str(tmp_path)]) == 0  # fmt: skip
    assert main(["report", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.html").read_text()
    assert name in text and "<canvas" in text
    assert not re.search(r"<tbody>\s*</tbody>", text)


@pytest.mark.usefixtures("as_brax_needs_it")
def test_a_brax_environment_is_loaded_without_a_word(recwarn):
    assert get_task(f"{EXAMPLES / 'reacher.py'}:TASK").name == "reacher"
    assert not [each for each in recwarn if "Brax" in str(each.message)]
