"""The stages of a run: what they write, that they skip what is done, and that a kill loses nothing."""

import hashlib
import json
import shutil

import numpy as np
import pytest
from conftest import tiny_settings

from qboot import qlearning
from qboot.study.pipeline import learning, loop
from qboot.study.pipeline.table import STAGES, stage
from qboot.study.store import files, runs
from qboot.study.store.artifacts import read_lineage
from qboot.study.store.files import RunError

CONTRACT = {
    "config.json", "history.csv", "lineage.npz", "pareto.npz", "actions.npz", "sensors.npz", "qlearning.csv",
    "qnets.npz", "transfer.csv",
}  # fmt: skip


def digests(folder):
    """Digest of every file but the configuration."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.name != "config.json"
    }


def columns(run, name):
    return {key: [float(value) for value in values] for key, values in files.read_csv(run.file(name)).items()}


class Killed(Exception):
    """Stands for a process that ends without a word."""


def test_a_run_folder_holds_what_it_should(tiny_run):
    names = {path.name for path in tiny_run.folder.iterdir()}
    assert names >= CONTRACT
    assert not [name for name in names if "checkpoint" in name or name.startswith(".")]
    config = json.loads(tiny_run.file("config.json").read_text())
    assert config["settings"]["seed"] == 0 and config["packages"]["jax"]
    history = files.read_csv(tiny_run.file("history.csv"))
    assert history["generation"] == ["0", "1", "2", "3"]
    assert history["episodes"] == ["16", "24", "32", "40"]
    qlearning = columns(tiny_run, "qlearning.csv")
    assert qlearning["episode"] == [1, 2, 3]
    transfer = files.read_csv(tiny_run.file("transfer.csv"))
    assert set(transfer["method"]) == {"QL", "ER", "ER+transfer"}
    generalisation = files.read_csv(tiny_run.file("generalisation.csv"))
    assert len(generalisation["score"]) == 2 * 6


def test_finished_stages_are_skipped(tiny_run):
    before = {path.name: path.stat().st_mtime_ns for path in tiny_run.folder.iterdir()}
    for each in STAGES:
        each.do(tiny_run)
    assert {path.name: path.stat().st_mtime_ns for path in tiny_run.folder.iterdir()} == before


def test_a_stage_that_is_done_again_removes_what_came_of_it(tiny_run, tmp_path):
    """Otherwise scores of the old networks would stand beside the new ones."""
    shutil.copytree(tiny_run.folder, tmp_path / "run")
    run = runs.load(tmp_path / "run")
    run.file("qnets.npz").unlink()
    stage("learn").do(run)
    assert digests(tiny_run.folder).keys() - digests(run.folder).keys() == {
        "generalisation.csv",
        "target_learn.csv",
        "target_er.csv",
        "target_er_transfer.csv",
        "transfer.csv",
    }
    stage("transfer").do(run)
    assert digests(run.folder) == digests(tiny_run.folder)


def test_a_killed_run_resumes_to_the_same_bytes(tiny_run, tmp_path, monkeypatch):
    """Every stage is killed in its middle, just after a save, and started again."""
    monkeypatch.setattr(loop, "SECONDS_BETWEEN_SAVES", 0.0)
    monkeypatch.setattr(learning, "EPISODES_PER_CALL", 1)
    run = runs.create(tmp_path / "A-0", tiny_run.settings)
    kills = 0
    for each in STAGES:
        for saves_before_kill in (1, 2, None):
            saves = 0

            def save(path, arrays, write=files.write_npz, limit=saves_before_kill):
                nonlocal saves
                write(path, arrays)
                if "checkpoint" in path.name:
                    saves += 1
                    if saves == limit:
                        raise Killed

            with monkeypatch.context() as patch:
                patch.setattr(files, "write_npz", save)
                try:
                    each.do(run)
                except Killed:
                    kills += 1
    assert kills >= 6
    assert digests(run.folder) == digests(tiny_run.folder)


def test_exploration_in_new_domains_goes_on_from_where_it_was(tiny_run, tmp_path, monkeypatch):
    shutil.copytree(tiny_run.folder, tmp_path / "run")
    run = runs.load(tmp_path / "run")
    for name in ("transfer.csv", "target_learn.csv"):
        run.file(name).unlink()
    begun = []
    init = qlearning.init

    def note(*given, **named):
        begun.append(init(*given, **named))
        return begun[-1]

    monkeypatch.setattr(qlearning, "init", note)
    stage("transfer").do(run)
    assert [int(state.episode) for state in begun] == [run.settings.episodes]
    assert digests(run.folder) == digests(tiny_run.folder)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "file.csv"
    files.write_csv(path, {"a": [1, 2]})

    def fail(stream):
        stream.write(b"half")
        raise Killed

    with pytest.raises(Killed):
        files.write(path, fail)
    assert [p.name for p in tmp_path.iterdir()] == ["file.csv"]
    assert files.read_csv(path) == {"a": ["1", "2"]}


@pytest.mark.parametrize("name", ["lineage.npz", "actions.npz", "sensors.npz", "qnets.npz"])
def test_a_truncated_file_is_named(tiny_run, tmp_path, name):
    folder = tmp_path / "run"
    shutil.copytree(tiny_run.folder, folder)
    run = runs.load(folder)
    content = run.file(name).read_bytes()
    run.file(name).write_bytes(content[: len(content) // 2])
    run.file("transfer.csv").unlink()
    for later in {"lineage.npz": ["sensors.npz"], "actions.npz": ["qnets.npz"], "sensors.npz": ["qnets.npz"]}.get(
        name, []
    ):
        run.file(later).unlink()
    with pytest.raises(RunError, match=f"{name} is damaged"):
        for each in STAGES:
            each.do(run)


def test_a_missing_stage_is_named(tmp_path):
    run = runs.create(tmp_path, tiny_settings())
    with pytest.raises(RunError, match="run the stage that makes it first"):
        stage("extract").do(run)


def test_other_settings_or_versions_are_refused(tmp_path):
    run = runs.create(tmp_path, tiny_settings())
    with pytest.raises(RunError, match="seed = 0, not 1"):
        runs.create(tmp_path, tiny_settings(seed=1))
    config = run.file("config.json")
    text = config.read_text()
    config.write_text(text.replace('"format": 1', '"format": 99'))
    with pytest.raises(RunError, match="format 99"):
        runs.load(tmp_path)
    config.write_text(text[:100])
    with pytest.raises(RunError, match="damaged"):
        runs.load(tmp_path)
    config.write_text(text.replace('"n_steps"', '"steps"'))
    with pytest.raises(RunError, match="does not fit"):
        runs.load(tmp_path)


def test_settings_survive_the_way_through_the_file(tmp_path):
    run = runs.create(tmp_path, tiny_settings())
    assert runs.load(tmp_path).settings == run.settings


def test_replayed_scores_must_be_the_saved_ones(tiny_run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(tiny_run.folder, folder)
    run = runs.load(folder)
    arrays = files.read_npz(run.file("lineage.npz"))
    files.write_npz(run.file("lineage.npz"), arrays | {"scores": arrays["scores"] + 1})
    run.file("sensors.npz").unlink()
    with pytest.raises(RunError, match="does not replay"):
        stage("extract").do(run)


def test_trees_of_arrays_survive_a_file(tiny_run):
    best = read_lineage(tiny_run)
    assert best.genomes.weights.shape == (len(best.ids), 75)
    assert best.scores.dtype == np.float32 and tiny_run.settings.evolution.horizon >= len(best.ids)
