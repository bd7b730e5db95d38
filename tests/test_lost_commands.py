"""Commands of the traces that no action gives, on a case made by hand."""

import numpy as np
import pytest
from conftest import record_all

from qboot.extraction.actions import ActionSet
from qboot.extraction.lost_commands import lost, on_side, uses
from qboot.study.pipeline.table import stage
from qboot.study.store import runs

# Ten steps of a wheel that goes both ways and of a gripper that opens once.
COMMANDS = np.stack([np.linspace(0, 1, 10), np.full(10, 0.9)], axis=1).astype(np.float32)
COMMANDS[3, 1] = 0.2
EFFECTORS = ("wheel", "gripper")


def actions(*rows):
    """Rows of slopes, intercepts (two each) and a duration."""
    table = np.array(rows, np.float32)
    return ActionSet(table[:, :2], table[:, 2:4], table[:, 4].astype(np.int32))


def test_a_linear_command_is_on_both_sides_when_it_crosses_the_middle():
    some = actions((0.1, 0, 0.3, 0.7, 4), (0, 0, 0.3, 0.7, 4), (-0.1, 0, 0.6, 0.7, 2), (-0.1, 0, 0.6, 0.7, 3))
    np.testing.assert_array_equal(on_side(some, 0, "below"), [True, True, False, True])
    np.testing.assert_array_equal(on_side(some, 0, "above"), [True, False, True, True])
    assert not on_side(some, 1, "below").any() and on_side(some, 1, "above").all()


def test_what_no_action_gives_is_told_with_its_share():
    holds = actions((0, 0, 0.9, 0.9, 5), (0.1, 0, 0.2, 0.9, 5))
    found = uses(COMMANDS, holds, EFFECTORS)
    assert found["gripper", "below"] == (pytest.approx(0.1), 0)
    assert found["gripper", "above"] == (pytest.approx(0.9), 2)
    assert found["wheel", "below"] == (pytest.approx(0.5), 1)
    assert lost(COMMANDS, holds, EFFECTORS) == "gripper below 0.5 (10.00% of the steps of the traces)"
    lets_go = actions((0, 0, 0.9, 0.9, 5), (0.1, -0.2, 0.2, 0.9, 5))
    assert lost(COMMANDS, lets_go, EFFECTORS) == ""


def test_extraction_warns_of_them(tiny_run, tmp_path, monkeypatch):
    run = runs.create(tmp_path / "A-0", tiny_run.settings)
    for name in stage("evolve").makes:
        run.file(name).write_bytes(tiny_run.file(name).read_bytes())
    record_all(run)
    monkeypatch.setattr("qboot.study.pipeline.extracting.lost", lambda *some: "crane below 0.5")
    with pytest.warns(UserWarning, match="A-0: no extracted action gives crane below 0.5: what needs it cannot be"):
        stage("extract").do(run)
