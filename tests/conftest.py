"""Shared fixtures: a tiny study, run once for all tests that only read it."""

import os
from pathlib import Path

# One store of compiled programs for all tests and the processes that they start. It is named before jax is imported;
# otherwise a command under test would name one of its own, for all tests after it.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
# Numbers of different kinds are never mixed by accident, in the processes that tests start either.
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")

import shutil
import warnings
from dataclasses import replace

import jax
import numpy as np
import pytest
from filelock import FileLock

from qboot.study.analysis import appendix, verdicts
from qboot.study.analysis.claims import claims
from qboot.study.controls import cells, sweep
from qboot.study.controls.conditions import WHATS
from qboot.study.pipeline import profiles
from qboot.study.pipeline.table import STAGES
from qboot.study.store import files, programs, provenance, runs
from qboot.study.store.settings import CellSettings

# Workers of the tests, and what they start, read each other's programs.
programs.write_whole()

OF_EVOSAX = ("cma_es", "open_es", "snes")


def promotion_for(name):
    """The promotion of types that a method works with: evosax mixes kinds of numbers."""
    return jax.numpy_dtype_promotion("standard" if name in OF_EVOSAX else "strict")


def pytest_collection_modifyitems(items):
    """Files that read the tiny study come last, but for one that makes it first: two processes would wait for it."""
    readers = [item.path for item in items if {"tiny_run", "tiny_study"} & set(item.fixturenames)]
    items.sort(key=lambda item: -1 if readers and item.path == readers[0] else item.path in readers)


TINY_SWEEP = {"n_runs": 2, "n_episodes": 3, "lanes": 1}


def tiny_settings(task="ball_collecting", source="A", seed=0, **changed):
    """Settings of a run that takes seconds."""
    settings = profiles.settings_of(task, "smoke", source, seed)
    evolution = replace(settings.evolution, population=8, generations=3, horizon=4)
    sizes = {"n_steps": 240, "episodes": 3, "target_episodes": 2, "target_generations": 1}
    return replace(settings, profile="tiny", evolution=evolution, **(sizes | changed))


@pytest.fixture
def tiny_sweep(monkeypatch):
    """Control experiments of the size of those in the tiny study."""
    size = profiles.ControlSize(TINY_SWEEP["n_runs"], TINY_SWEEP["n_episodes"])
    monkeypatch.setattr(profiles, "control_size_of", lambda task, what, profile: size)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """A function (name, make): a copy of the folder that `make(folder)` fills, once for all processes of the tests."""
    here = tmp_path_factory.getbasetemp()
    shared = here.parent if "PYTEST_XDIST_WORKER" in os.environ else here

    def get(name, make):
        folder, own = shared / name, tmp_path_factory.mktemp(name) / "copy"
        with FileLock(shared / f"{name}.lock"):
            if not folder.exists():
                make(shared / f"{name}.begun")
                (shared / f"{name}.begun").rename(folder)
        return Path(shutil.copytree(folder, own))

    return get


@pytest.fixture(scope="session")
def tiny_run(made_once):
    """A finished run of ball collecting; not to be changed."""

    def make(study):
        run = runs.create(study / "ball_collecting" / "A-0", tiny_settings())
        for stage in STAGES:
            stage.do(run)

    return runs.load(made_once("tiny_run", make) / "ball_collecting" / "A-0")


def record_all(run):
    """Have a run believe the files that a test has put into its folder."""
    for recipe in provenance.OF_CELLS if isinstance(run.settings, CellSettings) else provenance.OF_RUNS:
        for name in recipe.makes:
            if run.file(name).exists():
                provenance.record(run, name, files.digest(run.file(name)))


def claims_of(of_experiments, some):
    """The claims on runs of one task and on finished cells of each control experiment by its name."""
    return claims(verdicts.rows(some), [*verdicts.findings(some), *appendix.findings(of_experiments, some)])


def make_anew(run):
    """Have a run's actions be others in their bytes, though not in what they do."""
    path = run.file("actions.npz")
    files.write_npz(path, files.read_npz(path) | {"note": np.array("made anew")})
    record_all(run)


def begin_cells(folder, what, task="ball_collecting", **changed):
    """Cells of a control experiment that take seconds."""
    return cells.begin(cells.plan(folder, task, what, "tiny", **(TINY_SWEEP | changed)))


@pytest.fixture(scope="session")
def tiny_study(tiny_run, made_once):
    """A study with one run of ball collecting and its cells of all experiments; not to be changed."""

    def make(study):
        shutil.copytree(tiny_run.folder, study / "ball_collecting" / "A-0")
        with warnings.catch_warnings():
            # Three tiny networks give few different segments.
            warnings.filterwarnings("ignore", "only .* extracted actions are distinct")
            for what in WHATS:
                sweep.learn_cells(begin_cells(study, what), workers=2)

    return made_once("tiny_study", make)
