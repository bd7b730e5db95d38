"""What must never happen: something wrong believed, a number that is none, a mistake without an answer."""

import errno
import json
import os
import random
import shutil
import subprocess
import sys
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path

import jax
import numpy as np
import pytest
from conftest import begin_cells, record_all, tiny_settings
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments import reliability
from qboot import keys, qlearning
from qboot.cli import main
from qboot.envs import get_task
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.study.controls import cells, sweep
from qboot.study.pipeline import checks, evolving, learning
from qboot.study.pipeline.learning import Diverged
from qboot.study.pipeline.table import STAGES, stage
from qboot.study.report import page
from qboot.study.store import files, provenance, runs
from qboot.study.store.artifacts import key_of, task_of
from qboot.study.store.files import RunError

FILES = [name for each in STAGES for name in each.makes]


@pytest.fixture
def run(tiny_run, tmp_path):
    """A copy of the finished run, in a study of its own, that may be changed."""
    shutil.copytree(tiny_run.folder, tmp_path / "ball_collecting" / "A-0")
    return runs.load(tmp_path / "ball_collecting" / "A-0")


@pytest.mark.parametrize("way", [*reliability.DAMAGES, "another run's"])
@pytest.mark.parametrize("name", FILES)
def test_nothing_damaged_or_foreign_is_believed(run, name, way):
    path = run.file(name)
    if way == "another run's":
        other = runs.create(run.folder.with_name("A-1"), replace(run.settings, seed=1))
        shutil.copy(path, other.file(name))
        record_all(other)
        entries = json.loads(run.file(provenance.RECORD).read_text())
        theirs = json.loads(other.file(provenance.RECORD).read_text())
        run.file(provenance.RECORD).write_text(json.dumps(entries | theirs))
    else:
        path.write_bytes(reliability.DAMAGES[way](path.read_bytes(), random.Random(name)))
    maker = next(each for each in STAGES if name in each.makes)
    assert not maker.is_done(run)
    with pytest.raises(RunError, match=rf"{name} .*: run `qboot {maker.name} --out"):
        provenance.require(run, name)


@pytest.mark.parametrize("content", ["", "{", "[]", '{"lineage.npz": 3}', '{"lineage.npz": {"sha256": "x"}}'])
def test_without_its_record_no_file_is_believed(run, content):
    run.file(provenance.RECORD).write_text(content)
    assert not any(each.is_done(run) for each in STAGES)
    provenance.set_aside_faulty(run, STAGES[1].recipe)
    assert {path.name for path in run.folder.glob("*.set-aside")} == {
        "files.json.set-aside",
        "actions.npz.set-aside",
        "sensors.npz.set-aside",
    }


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"noise" * 50, None])
def test_a_checkpoint_that_is_not_to_be_believed_is_set_aside(tiny_run, run, content):
    """None stands for one of another run: it is whole, but not this one's."""
    checkpoint = run.file("learn.checkpoint.npz")
    if content is None:
        files.write_npz(checkpoint, {"identity": np.array("learn.checkpoint.npz of another run")})
    else:
        checkpoint.write_bytes(content)
    for name in stage("learn").makes:
        run.file(name).unlink()
    stage("learn").do(run)
    assert run.file("learn.checkpoint.npz.set-aside").exists()
    assert run.file("qnets.npz").read_bytes() == tiny_run.file("qnets.npz").read_bytes()


def test_checkpoints_of_parts_are_not_mistaken_for_each_other(run):
    """The two evolutions on the target set have the same settings."""
    output = evolving.Output(run, stage("transfer").recipe)
    output.save("target_er.checkpoint.npz", {"value": np.ones(3)})
    os.rename(run.file("target_er.checkpoint.npz"), run.file("target_er_transfer.checkpoint.npz"))
    assert output.restored("target_er_transfer.checkpoint.npz", lambda arrays, path: arrays) is None


def test_a_learner_that_diverges_stops_and_says_so(run, capsys):
    """Learning rates of 1e6 fill networks with what is no number."""
    other = runs.create(
        run.folder.with_name("A-1"), replace(run.settings, learner=replace(run.settings.learner, alpha=1e6))
    )
    for name in ("history.csv", "lineage.npz", "pareto.npz", "actions.npz", "sensors.npz"):
        shutil.copy(run.file(name), other.file(name))
    record_all(other)
    assert main(["learn", "--out", str(other.folder)]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"qboot: {other.folder}: Q-learning diverged in episode ") and "--learner.alpha" in said
    assert not other.file("qnets.npz").exists() and not other.file("qlearning.csv").exists()
    assert other.file("qlearning.diverged.csv").exists()
    text = page.write(run.folder.parents[1]).read_text()
    assert "for the learner diverged (qlearning.diverged.csv has its history)" in text


def test_a_cell_that_diverges_leaves_the_others_alone(tiny_study, tmp_path, monkeypatch):
    study = tmp_path / "study"
    shutil.copytree(tiny_study, study)
    shutil.rmtree(study / "ablations" / "ball_collecting" / "actions")
    some = begin_cells(study, "actions")
    bad = next(iter(some))
    key = jax.random.key_data(keys.key(sweep.key_of_cell(bad), "episodes"))
    monkeypatch.setattr(
        learning,
        "divergence",
        lambda learner, settings: "diverged" if (jax.random.key_data(learner.state.key) == key).all() else "",
    )
    with pytest.raises(Diverged, match=f"^{bad.folder}: diverged$"):
        sweep.learn_cells(some, workers=1)
    assert [cell for cell in some if not cell.file("qlearning.csv").exists()] == [bad]
    assert bad.file("qlearning.diverged.csv").exists() and not bad.file("learn.checkpoint.npz").exists()
    faults = cells.faults(study, "ball_collecting", "actions")
    assert len(faults) == 1 and "for the learner diverged" in faults[0] and "qboot ablate --task" in faults[0]
    finished = cells.find(study, "ball_collecting", "actions")
    assert bad not in [cell for of_condition in finished.values() for cell in of_condition]


def test_no_number_that_is_none_leaves_a_stage(run):
    output = evolving.Output(run, stage("learn").recipe)
    before = run.file("qnets.npz").read_bytes()
    for bad in (np.nan, np.inf):
        with pytest.raises(RunError, match="weights is no number"):
            output.write_npz("qnets.npz", {"weights": np.array([1.0, bad])})
        with pytest.raises(RunError, match="score is no number"):
            output.write_csv("qlearning.csv", {"episode": [1], "score": [bad]})
    assert run.file("qnets.npz").read_bytes() == before


# Values for every kind of setting, a few of them valid almost anywhere.
VALUES = {
    int: st.integers(0, 200),
    float: st.floats(0.0, 2.0, exclude_min=True, allow_subnormal=False),
    bool: st.booleans(),
}


@st.composite
def valid_settings(draw):
    """Settings of a run with some numbers and flags changed, as far as the classes allow."""

    def changed(value):
        new = {}
        for field in fields(value):
            old = getattr(value, field.name)
            if is_dataclass(old):
                new[field.name] = changed(old)
            elif type(old) in VALUES and draw(st.booleans()):
                new[field.name] = draw(VALUES[type(old)])
        try:
            return replace(value, **new)
        except ValueError:
            return value

    return changed(tiny_settings())


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(some=valid_settings())
def test_settings_survive_the_way_through_the_file(some, tmp_path):
    folder = tmp_path / "run"
    run = runs.create(folder, some)
    loaded = runs.load(folder)
    shutil.rmtree(folder)
    assert loaded.settings == some
    identities = [provenance.identity(each, recipe) for each in (run, loaded) for recipe in provenance.OF_RUNS]
    assert identities[: len(identities) // 2] == identities[len(identities) // 2 :]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_setting_of_another_kind_in_the_file_is_refused(data, tiny_run, tmp_path):
    config = json.loads(tiny_run.file("config.json").read_text())
    place = config["settings"]
    name = data.draw(st.sampled_from(sorted(place)))
    while isinstance(place[name], dict):
        place = place[name]
        name = data.draw(st.sampled_from(sorted(place)))
    old = place[name]
    others = st.sampled_from([None, [], {}, [[]], "no name", -1, float("nan"), float("inf"), 1.5, "", [1, "x"]])
    place[name] = data.draw(others.filter(lambda value: isinstance(old, str) is not isinstance(value, str)))
    (tmp_path / "config.json").write_text(json.dumps(config))
    if (isinstance(old, float) and place[name] == 1.5) or (place[name] == [] and name == "diversities"):
        return
    try:
        checks.check(runs.load(tmp_path).settings)
    except (RunError, ValueError) as error:
        assert name in str(error) or "setting" in str(error)
    else:
        assert isinstance(old, float) or name in ("tolerance",)


BAD = [line for line in reliability.bad_commands() if "--task" in line and "new" in line][::9]


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_a_bad_command_line_gets_one_answer_and_leaves_nothing(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said = reliability.qboot(*arguments)
    assert code == 2 and said.strip() and "Traceback" not in said and "TRACEBACK" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"n_steps": 8}, "sensors.lags steps, which are 8"),
        ({"n_steps": 10**9}, "GiB of memory are needed"),
        ({"source": "Z"}, "unknown source 'Z'"),
        ({"physics": "foo"}, "unknown physics 'foo'"),
        ({"episodes": 2**31}, "episodes is 2147483648: it must be at most 2147483647"),
    ],
)
def test_settings_that_cannot_work_are_refused_before_a_stage_begins(change, words):
    with pytest.raises(ValueError, match=words):
        checks.check(replace(tiny_settings(), **change))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO, errno.ENAMETOOLONG])
def test_a_disk_that_refuses_is_one_line(tiny_run, tmp_path, monkeypatch, capsys, number):
    run = runs.create(tmp_path / "run", tiny_run.settings)

    def refuse(handle):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(files.os, "fsync", refuse)
    assert main(["evolve", "--out", str(run.folder)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("qboot: ") and os.strerror(number) in said
    assert {path.name for path in run.folder.iterdir()} == {"config.json"}


def test_any_path_and_locale_will_do(tiny_run, tmp_path):
    """A path with all kinds of letters, read and written where the locale knows only English ones."""
    folder = tmp_path / "каталог 実験 é'\" $x"
    shutil.copytree(tiny_run.folder, folder)
    (folder / "sensors.npz").write_bytes(b"")
    environment = os.environ | {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "qboot.cli", "learn", "--out", str(folder)]
    (folder / "qnets.npz").unlink()
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", errors="replace")
    assert done.returncode == 2 and "sensors.npz is damaged" in done.stderr and "Traceback" not in done.stderr


def test_nothing_compiles_twice_for_the_same_shapes(tiny_run):
    """Generations, episodes and evaluations after the first ones use the programs that there are."""
    problem = evolving.source_problem(tiny_run, 1)
    algorithm = ALGORITHMS[problem.settings.algorithm]
    learner = learning.problem_on(tiny_run, task_of(tiny_run).source_domains("A"))

    def everything(key):
        state, _ = algorithm.init(replace(problem, key=key), None)
        for _ in range(2):
            state, _ = algorithm.step(replace(problem, key=key), state)
        learned, _ = qlearning.learn(qlearning.init(key, learner), learner, 1)
        qlearning.learn(learned, learner, 1)
        qlearning.evaluate(learned.networks, key, learner)

    everything(key_of(tiny_run, "first"))
    with jax.log_compiles(), pytest.MonkeyPatch.context() as patch:
        compiled = []
        from jax._src import compiler

        real = compiler.compile_or_get_cached
        patch.setattr(compiler, "compile_or_get_cached", lambda *a, **k: (compiled.append(a[1]), real(*a, **k))[1])
        everything(key_of(tiny_run, "second"))
    assert compiled == []
    assert get_task("ball_collecting") == get_task("ball_collecting")  # programs are kept by their task


@pytest.mark.slow
def test_killed_studies_go_on_to_the_same_bytes(tmp_path):
    assert reliability.kills(6, random.Random(0), tmp_path) == []


@pytest.mark.slow
def test_a_full_disk_costs_nothing(tmp_path):
    assert reliability.disk(1, random.Random(0), tmp_path) == []


def test_every_setting_decides_about_some_file():
    """A setting that no recipe names would be ignored when files are judged; these change no result."""
    used = {name for recipe in provenance.OF_RUNS for name in recipe.settings}
    assert set(asdict(tiny_settings())) - used == {"task", "profile"}
    assert Path(reliability.__file__).exists()
