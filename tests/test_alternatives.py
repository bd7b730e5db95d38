"""The experiments on other methods: every alternative is in a panel, tables and figures come from the small files."""

import numpy as np
import pytest

from experiments import alternatives, yardsticks
from qboot.study.pipeline import profiles
from qboot.study.store import files

METHODS = [(key, name) for key, phase in alternatives.PHASES.items() for name in phase.names]


@pytest.fixture
def tables(tmp_path):
    """Three seeds; the paper's choices score 1, 2 and 3, each alternative 5."""
    rows = [
        (key, name, seed, float(seed + 1) if name == alternatives.PHASES[key].names[0] else 5.0, 8.0)
        for key, name in METHODS
        for seed in range(3)
    ]
    columns = ("phase", "method", "seed", "score", "top")
    files.write_csv(tmp_path / "scores.csv", dict(zip(columns, zip(*rows, strict=True), strict=True)))
    rows = [(key, name, at, 0.0, 1.0, 2.0) for key, name in METHODS for at in (1, 10)]
    columns = ("phase", "method", "episodes", "lower", "median", "upper")
    files.write_csv(tmp_path / "curves.csv", dict(zip(columns, zip(*rows, strict=True), strict=True)))
    return tmp_path


def test_what_was_noted_is_told_and_drawn_without_the_runs(tables, capsys):
    assert alternatives.main([str(tables), "--seeds", "0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(METHODS)
    assert "| search | `nsga2` | 3 | 2.00 [1.00, 3.00] | 1.50 to 2.50 | | the paper's |" in lines
    assert "| search | `cma_es` | 3 | 5.00 [5.00, 5.00] | 5.00 to 5.00 | 1.00 | 0.064 |" in lines
    assert (tables / "scores.png").exists() and (tables / "curves.png").exists()


def test_each_panel_has_the_papers_choice_once_and_first(tables):
    panels = alternatives.panels(alternatives.read(tables / "scores.csv", "phase", "method"))
    assert list(panels) == ["Policy search", "Actions", "Sensors", "Learners"]
    assert list(panels["Actions"]) == ["the paper's", "hidden_markov", "k_means", "gaussian_mixture"]
    assert sum(len(some) - 1 for some in panels.values()) == len(METHODS) - len(alternatives.PHASES)
    np.testing.assert_array_equal(panels["Learners"]["the paper's"]["score"], [1, 2, 3])


def test_an_alternative_differs_in_its_name_and_what_that_needs():
    settings = profiles.settings_of("box_pushing", "smoke", "A", 0)
    for key, name in METHODS:
        phase = alternatives.PHASES[key]
        other = alternatives.changed(settings, phase, name)
        assert getattr(getattr(other, phase.room), phase.field) == name
    assert alternatives.changed(settings, alternatives.PHASES["learner"], "adam").learner.alpha == 0.001


def test_missing_tables_are_named(tmp_path, capsys):
    assert alternatives.main([str(tmp_path), "--seeds", "0"]) == 2
    assert "scores.csv does not exist" in capsys.readouterr().err
    assert yardsticks.main([str(tmp_path)]) == 2
    assert "scores.csv does not exist" in capsys.readouterr().err


def test_yardsticks_are_told_and_drawn_without_the_runs(tmp_path, capsys):
    rows = [
        (name, seed, 1e4, score, 3.0) for name, score in (("QL", 1.0), ("ER", 2.0), ("PPO", 3.0)) for seed in (0, 1)
    ]
    files.write_csv(tmp_path / "scores.csv", dict(zip(yardsticks.SCORES, zip(*rows, strict=True), strict=True)))
    files.write_csv(
        tmp_path / "curves.csv", dict(zip(yardsticks.CURVES, list(zip(*rows, strict=True))[:4], strict=True))
    )
    assert yardsticks.main([str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "| PPO (Brax) | 2 | 10,000 | 3.00 [3.00, 3.00] | 3.00 to 3.00 | 1.00 | 0.194 |" in lines
    assert (tmp_path / "yardsticks.png").exists()
