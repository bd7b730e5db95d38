"""The stages of a run: what they write, that they skip what is done, and that a kill loses nothing."""

import hashlib
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import tiny_settings
from toy_tasks import CELLS, RANDOM, corridor

from qboot import envs, qlearning
from qboot.cli import main
from qboot.envs import registry
from qboot.study.analysis.curves import Curve, to_the_end
from qboot.study.analysis.statistics import on_grid
from qboot.study.pipeline import evolving, extracting, learning, loop, profiles
from qboot.study.pipeline.table import STAGES, stage
from qboot.study.store import files, runs
from qboot.study.store.artifacts import read_actions, read_lineage
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.recipes import EVOLVE

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


def broken(*args, **kwargs):
    raise Killed


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


@pytest.fixture
def run(tiny_run, tmp_path):
    """A copy of the finished run that may be changed."""
    shutil.copytree(tiny_run.folder, tmp_path / "run")
    return runs.load(tmp_path / "run")


@pytest.mark.parametrize("name", [name for each in STAGES for name in each.makes])
def test_a_deleted_file_is_made_again(tiny_run, run, name):
    """By its own stage alone: what later stages made of the same bytes stays good."""
    run.file(name).unlink()
    times = {path.name: path.stat().st_mtime_ns for path in run.folder.iterdir()}
    maker = next(each for each in STAGES if name in each.makes)
    assert [each.name for each in STAGES if not each.is_done(run)] == [maker.name]
    for each in STAGES:
        each.do(run)
    assert digests(run.folder) == digests(tiny_run.folder)
    later = [each for each in STAGES[STAGES.index(maker) + 1 :] for each in each.makes]
    assert all(run.file(other).stat().st_mtime_ns == times[other] for other in later)


def test_the_advice_of_a_reader_works(tiny_run, run, capsys):
    """A reader names the command that mends what it cannot read."""
    content = run.file("actions.npz").read_bytes()
    run.file("actions.npz").write_bytes(content[:-100])
    run.file("qnets.npz").unlink()
    with pytest.raises(RunError) as refused:
        stage("learn").do(run)
    command = re.search("`qboot (.*?)`", str(refused.value)).group(1)
    assert main(command.split()) == 0
    assert "actions.npz is damaged, or was changed: set aside" in capsys.readouterr().err
    stage("learn").do(run)
    run.file("actions.npz.set-aside").unlink()
    assert digests(run.folder) == digests(tiny_run.folder)


def test_a_stage_that_fails_leaves_what_later_ones_made(run, monkeypatch, capsys):
    """As when the settings name a learner that there is none of, or the work breaks off."""
    run.file("qnets.npz").unlink()
    left = digests(run.folder)
    config = run.file("config.json").read_text()
    run.file("config.json").write_text(config.replace('"q_learning"', '"wish"'))
    assert main(["learn", "--out", str(run.folder)]) == 2
    assert "'wish'" in capsys.readouterr().err and digests(run.folder) == left
    run.file("config.json").write_text(config)
    with monkeypatch.context() as patch:
        patch.setattr(learning, "learned", broken)
        with pytest.raises(Killed):
            stage("learn").do(run)
    later = {name: digest for name, digest in left.items() if name in stage("transfer").makes}
    assert later and later.items() <= digests(run.folder).items()
    stage("learn").do(run)
    assert all(each.is_done(run) for each in STAGES)


def test_results_of_other_bytes_are_outdated(run):
    """Whoever puts another lineage in place has other actions to extract, and to learn with."""
    arrays = files.read_npz(run.file("lineage.npz"))
    Output(run, EVOLVE).write_npz("lineage.npz", arrays | {"births": arrays["births"] * 2})
    assert [each.is_done(run) for each in STAGES] == [True, False, True, False]
    with pytest.raises(RunError, match=r"actions.npz was made with other settings, or from other files.*qboot extract"):
        read_actions(run)


@pytest.mark.parametrize(
    ("change", "undone"),
    [
        ({"seed": 5}, ["evolve", "extract", "learn", "transfer"]),
        ({"target_generations": 7}, ["transfer"]),
        ({"episodes": 7}, ["learn"]),
        ({"profile": "other"}, []),
    ],
)
def test_settings_count_where_they_are_used(run, change, undone):
    """Also when somebody deletes config.json and begins another run in the folder."""
    run.file("config.json").unlink()
    other = runs.create(run.folder, replace(run.settings, **change))
    assert [each.name for each in STAGES if not each.is_done(other)] == undone


def test_a_killed_run_resumes_to_the_same_bytes(tiny_run, tmp_path, monkeypatch):
    """Every stage is killed in its middle, just after a save, and started again."""
    monkeypatch.setattr(loop, "SECONDS_BETWEEN_SAVES", 0.0)
    monkeypatch.setattr(learning, "EPISODES_PER_CALL", 1)
    run = runs.create(tmp_path / "A-0", tiny_run.settings)
    kills = 0
    for each in STAGES:
        for saves_before_kill in (1, 2, None):
            saves = 0

            def save(output, name, arrays, save=Output.save, limit=saves_before_kill):
                nonlocal saves
                save(output, name, arrays)
                saves += 1
                if saves == limit:
                    raise Killed

            with monkeypatch.context() as patch:
                patch.setattr(Output, "save", save)
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


@pytest.fixture(params=["stays", "may be lost"])
def corridor_run(request, tmp_path, monkeypatch):
    """A run of a robot that finds the goals of both domains within some generations."""
    monkeypatch.setattr(registry, "_registered", {})
    envs.register(corridor((CELLS - 1, RANDOM), (0, RANDOM), max_steps=20))
    settings = profiles.settings_of("corridor", "smoke", "A", 0)
    changed = replace(settings.evolution, population=16, reevaluate=request.param != "stays")
    return runs.create(tmp_path / "A-0", replace(settings, evolution=changed, target_generations=30))


def test_evolution_on_the_target_set_ends_with_the_top_score_where_it_stays(corridor_run):
    settings, domains = corridor_run.settings, envs.get_task("corridor").target_domains("A")
    problem = evolving.problem_on(corridor_run, domains, "target_er", workers=1)
    output = Output(corridor_run, stage("transfer").recipe)
    evolving.evolved(output, problem, 30, "target_er", "target_er.csv", until_top=True)
    evolving.evolved(output, problem, 30, "target_er_transfer", "target_er_transfer.csv")
    short, whole = (
        np.array([files.read_csv(corridor_run.file(f"{part}.csv"))[name] for name in ("episodes", "best")], float)
        for part in ("target_er", "target_er_transfer")
    )
    n = short.shape[1]
    np.testing.assert_array_equal(whole[:, :n], short)
    (episodes, best), top = whole, 2
    assert len(best) == 31 and best.max() == top
    if settings.evolution.reevaluate:
        assert n == 31
        return
    assert 1 < n < 31 and (best[: n - 1] < top).all() and (best[n - 1 :] == top).all()
    # Its curve goes on level to where it would have ended.
    curve = to_the_end(corridor_run, Curve(*short))
    np.testing.assert_array_equal(on_grid(*curve, episodes), best)
    assert curve.episodes[-1] == episodes[-1]


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "file.csv"
    files.write_csv(path, {"a": [1, 2]})

    def fail(digest):
        raise Killed

    with pytest.raises(Killed):
        files.write(path, b"new", before=fail)
    assert [p.name for p in tmp_path.iterdir()] == ["file.csv"]
    assert files.read_csv(path) == {"a": ["1", "2"]}


def test_a_missing_stage_is_named(tmp_path):
    run = runs.create(tmp_path / "new", tiny_settings())
    with pytest.raises(RunError, match=r"lineage.npz does not exist: run `qboot evolve --out .*new`"):
        stage("extract").do(run)
    assert [path.name for path in run.folder.iterdir()] == ["config.json"]


def test_other_settings_or_versions_are_refused(tmp_path):
    run = runs.create(tmp_path, tiny_settings())
    with pytest.raises(RunError, match="seed = 0, not 1"):
        runs.create(tmp_path, tiny_settings(seed=1))
    config = run.file("config.json")
    text = config.read_text()
    config.write_text(text.replace('"format": 2', '"format": 99'))
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


def test_replayed_scores_must_be_the_saved_ones(run):
    arrays = files.read_npz(run.file("lineage.npz"))
    Output(run, EVOLVE).write_npz("lineage.npz", arrays | {"scores": arrays["scores"] + 1})
    with pytest.raises(RunError, match="does not replay"):
        stage("extract").do(run)


def test_a_network_that_rounding_decided_otherwise_is_warned_of(run, monkeypatch):
    arrays = files.read_npz(run.file("lineage.npz"))
    n = len(arrays["scores"])
    changed = arrays["scores"] + (np.arange(n) == n // 2)
    Output(run, EVOLVE).write_npz("lineage.npz", arrays | {"scores": changed.astype(np.float32)})
    monkeypatch.setattr(extracting, "ROUNDED_OTHERWISE", 1 / n)
    with pytest.warns(UserWarning, match=f"1 of the {n} networks .* rounding"):
        stage("extract").do(run)
    monkeypatch.setattr(extracting, "ROUNDED_OTHERWISE", 0.9 / n)
    with pytest.raises(RunError, match="does not replay"):
        extracting.replayed(run, 1)


def test_trees_of_arrays_survive_a_file(tiny_run):
    best = read_lineage(tiny_run)
    assert best.genomes.weights.shape == (len(best.ids), 75)
    assert best.scores.dtype == np.float32 and tiny_run.settings.evolution.horizon >= len(best.ids)
