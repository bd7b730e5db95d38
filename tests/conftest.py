"""Shared fixtures: a tiny study, run once for all tests that only read it."""

import shutil

import pytest

from qboot.study.controls import conditions as ablations
from qboot.study.controls import sweep
from qboot.study.pipeline import profiles
from qboot.study.pipeline.profiles import Size
from qboot.study.pipeline.stages import STAGES
from qboot.study.store import runs

TINY = Size(1, ("A",), 8, 3, 120, 4, 3, 2, 1)

TINY_SWEEP = {"n_runs": 2, "n_episodes": 3, "lanes": 4}


def tiny_settings(task="ball_collecting", source="A", seed=0, size=TINY):
    """Settings of a run that takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(profiles.PROFILES, "tiny", {task: size})
        return profiles.settings_of(task, "tiny", source, seed)


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
    """A finished run of ball collecting; not to be changed."""
    run = runs.create(tmp_path_factory.mktemp("study") / "ball_collecting" / "A-0", tiny_settings())
    for stage in STAGES.values():
        stage(run, 1)
    return run


def begin_cells(folder, what, **changed):
    """Cells of a control experiment that take seconds."""
    return ablations.begin(folder, "ball_collecting", what, "tiny", **(TINY_SWEEP | changed))


@pytest.fixture(scope="session")
def tiny_study(tiny_run, tmp_path_factory):
    """A study with one run of ball collecting and its cells of all experiments; not to be changed."""
    folder = tmp_path_factory.mktemp("ablations")
    shutil.copytree(tiny_run.folder, folder / "ball_collecting" / "A-0")
    for what in ablations.WHATS:
        sweep.learn_cells(begin_cells(folder, what), workers=2)
    return folder
