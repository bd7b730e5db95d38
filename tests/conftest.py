"""Shared fixtures: a tiny study, run once for all tests that only read it."""

import pytest

from qboot.study import profiles, runs
from qboot.study.profiles import Size
from qboot.study.stages import STAGES

TINY = Size(1, ("A",), 8, 3, 120, 4, 3, 2, 1)


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
