"""Control experiments: what cells learn with, that vmapped cells are single ones, and that each can be made again."""

import hashlib
import shutil
from dataclasses import replace

import jax
import numpy as np
import pytest
from conftest import TINY_SWEEP, begin_cells, make_anew, record_all

from qboot.envs import get_task
from qboot.extraction import baselines
from qboot.extraction.segmentation import Segments
from qboot.study.controls import cells as folders
from qboot.study.controls import segments, shapes, sweep
from qboot.study.controls.conditions import WHATS, Place, conditions, is_shared, places
from qboot.study.pipeline import learning, loop
from qboot.study.pipeline.extracting import ReplaysOtherwise
from qboot.study.report import page
from qboot.study.store import files, lock, runs
from qboot.study.store.artifacts import read_actions, read_selection
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.settings import CellSettings

BALL = get_task("ball_collecting")


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "config.json"
    }


def cells_of(tiny_study, what):
    return {name: cells[0] for name, cells in folders.find(tiny_study, "ball_collecting", what).items()}


def test_every_condition_has_its_cells(tiny_study):
    for what in WHATS:
        found = folders.find(tiny_study, "ball_collecting", what)
        assert list(found) == list(conditions(BALL, what))
        for condition, cells in found.items():
            assert [cell.settings.seed for cell in cells] == list(range(TINY_SWEEP["n_runs"]))
            for cell in cells:
                assert cell.folder.parent.parent.name == cell.settings.what
                names = {path.name for path in cell.folder.iterdir()}
                assert names == {"config.json", "files.json", "actions.npz", "sensors.npz", "qlearning.csv"}
                place = Place(cell.settings.what, cell.settings.condition)
                assert place == places(BALL, what)[condition]
                assert files.read_csv(cell.file("qlearning.csv"))["episode"] == ["1", "2", "3"]


def test_only_the_actions_differ_in_the_first_experiment(tiny_study, tiny_run):
    cells = cells_of(tiny_study, "actions")
    chosen = baselines.chosen_sensors(BALL.expert.sensors, BALL.sensors)
    for cell in cells.values():
        np.testing.assert_array_equal(read_selection(cell), chosen)
        assert len(read_actions(cell).durations) == 17
    extracted, human, random = (read_actions(cells[name]) for name in ("extracted", "human", "random"))
    np.testing.assert_array_equal(extracted.intercepts, read_actions(tiny_run).intercepts)
    assert (human.durations == 15).all()
    assert random.durations.min() >= 5 and random.durations.max() <= 25
    others = folders.find(tiny_study, "ball_collecting", "actions")["random"]
    assert (read_actions(others[1]).intercepts != random.intercepts).any()


def test_only_the_sensors_differ_in_the_second_experiment(tiny_study, tiny_run):
    cells = cells_of(tiny_study, "sensors")
    numbers = {name: int(read_selection(cell).sum()) for name, cell in cells.items()}
    assert numbers["instant"] == 13
    assert numbers["human"] == baselines.chosen_sensors(BALL.expert.sensors, BALL.sensors).sum()
    assert numbers["selected"] == numbers["random+"] == read_selection(tiny_run).sum()
    assert 1 <= numbers["random"] <= 156
    for cell in cells.values():
        assert (read_actions(cell).durations == 15).all()


def test_the_third_experiment_has_its_numbers_of_actions(tiny_study, tiny_run):
    for name, cell in cells_of(tiny_study, "n_actions").items():
        assert len(read_actions(cell).durations) == int(name) == cell.settings.actions.n_actions
    same = read_actions(cells_of(tiny_study, "n_actions")["17"])
    np.testing.assert_array_equal(same.slopes, read_actions(tiny_run).slopes)


def test_cells_side_by_side_are_those_that_learn_alone(tiny_study, tmp_path, monkeypatch):
    """In a program of four, padded to the larger instead of the largest of the task: the same but for rounding; each is
    made again to the byte.
    """
    monkeypatch.setattr(shapes, "costs_little", lambda *_: False)
    copied = tmp_path / "study"
    shutil.copytree(tiny_study / "ball_collecting", copied / "ball_collecting")
    begun = begin_cells(copied, "sensors", lanes=4)
    some = {cell: run for cell, run in begun.items() if cell.settings.condition == "random"}
    sweep.learn_cells(some, workers=1)
    assert len(set(map(shapes.shape_of, some))) == 2 and len(set(shapes.shapes_of(list(some)).values())) == 1
    for cell in some:
        alone = tiny_study / cell.folder.relative_to(copied) / "qlearning.csv"
        together = cell.file("qlearning.csv")
        for name, values in files.read_csv(alone).items():
            others = np.array(files.read_csv(together)[name], float)
            np.testing.assert_allclose(np.array(values, float), others, rtol=1e-4, atol=1e-6)
    before = digests(copied)
    together.unlink()
    sweep.learn_cells(some, workers=1)
    assert digests(copied) == before


def long(cell):
    """A cell that would learn for so long that a program of its own is worth compiling."""
    return replace(cell, settings=replace(cell.settings, episodes=100_000))


def test_one_by_one_the_shape_of_a_cell_does_not_depend_on_other_cells(tiny_study):
    """Nor do its results, then, whose last bits padding may change."""
    cells = [cell for some in folders.find(tiny_study, "ball_collecting", "sensors").values() for cell in some]
    long_ones = list(map(long, cells))
    found = shapes.shapes_of(cells + long_ones)
    assert len({found[cell] for cell in cells}) == 1 and len({found[cell] for cell in long_ones}) > 2
    for cell in cells + long_ones:
        assert found[cell] == shapes.shapes_of([cell])[cell]


def test_who_pays_for_room_does_not_share(tiny_study):
    [cell, *_] = folders.find(tiny_study, "ball_collecting", "sensors")["random"]
    fitted = replace(cell.settings.learner, algorithm="fitted_q")
    assert shapes.shape_of(replace(cell, settings=replace(cell.settings, learner=fitted))) == shapes.shape_of(
        long(cell)
    )


def test_the_largest_shape_has_room_for_every_cell(tiny_study):
    for what in WHATS:
        for some in folders.find(tiny_study, "ball_collecting", what).values():
            for cell in some:
                own, shared = shapes.shape_of(long(cell)), shapes.shape_of(cell)
                assert all(least <= most for least, most in zip(own, shared, strict=True))


def test_a_deleted_cell_is_made_again_alone_and_to_the_byte(tiny_study, tmp_path):
    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    before = digests(copied)
    cells = [cell for cell in begin_cells(copied, "sensors") if cell.settings.what == "sensors"]
    times = {cell.folder: cell.file("qlearning.csv").stat().st_mtime_ns for cell in cells}
    gone = cells[3].folder
    shutil.rmtree(gone)
    sweep.learn_cells(begin_cells(copied, "sensors"), workers=1)
    assert digests(copied) == before
    for folder, time in times.items():
        is_same = (folder / "qlearning.csv").stat().st_mtime_ns == time
        assert is_same == (folder != gone)


def test_killed_cells_go_on_to_the_same_bytes(tiny_study, tmp_path, monkeypatch):
    class Killed(Exception):
        pass

    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    before = digests(copied)
    shutil.rmtree(copied / "ablations" / "ball_collecting" / "actions")
    monkeypatch.setattr(loop, "SECONDS_BETWEEN_SAVES", 0.0)
    monkeypatch.setattr(learning, "EPISODES_PER_CALL", 1)
    save = Output.save
    kills = 0
    for limit in (1, 3, 6, 100):
        saves = 0

        def save_some(output, name, arrays, limit=limit):
            nonlocal saves
            save(output, name, arrays)
            saves += 1
            if saves == limit:
                raise Killed

        monkeypatch.setattr(Output, "save", save_some)
        try:
            sweep.learn_cells(begin_cells(copied, "actions"), workers=1)
        except Killed:
            kills += 1
    assert kills >= 2
    assert digests(copied) == before


def test_cells_from_an_evolved_run_that_was_made_anew_are_not_believed(tiny_study, tmp_path, monkeypatch):
    """Until they are compared with it, by who owns them; where what they learn with is the same, they stay."""
    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    before = folders.find(copied, "ball_collecting", "actions")
    make_anew(runs.load(copied / "ball_collecting" / "A-0"))
    assert folders.find(copied, "ball_collecting", "actions") == {}
    faults = folders.faults(copied, "ball_collecting", "actions")
    assert len(faults) == 6 and all("or from other files than those of now: run `qboot ablate" in one for one in faults)
    owned, own = [], lock.owned
    monkeypatch.setattr(lock, "owned", lambda folder: owned.append(folder) or own(folder))
    monkeypatch.setattr(sweep, "_learn_block", None)  # nothing is learned again
    cells = begin_cells(copied, "actions")
    for _ in range(2):  # the second time, nothing is left to do
        sweep.learn_cells(cells, workers=1)
        assert owned == [copied / "ablations" / "ball_collecting" / "actions"]
    assert folders.find(copied, "ball_collecting", "actions") == before


def test_a_lineage_from_other_hardware_keeps_its_own_cells_back_alone(tiny_study, tmp_path, monkeypatch):
    study = tmp_path / "study"
    shutil.copytree(tiny_study, study)
    shutil.rmtree(study / "ablations" / "ball_collecting" / "n_actions" / "4")
    some = begin_cells(study, "n_actions")
    bad = next(cell for cell in some if cell.settings.condition == "4")
    equip = folders.equip

    def elsewhere(cell, evolved):
        if cell == bad:
            raise ReplaysOtherwise("it was made elsewhere")
        equip(cell, evolved)

    with monkeypatch.context() as patch:
        patch.setattr(folders, "equip", elsewhere)
        with pytest.raises(RunError, match=r"^it was made elsewhere$"):
            sweep.learn_cells(some, workers=1)
    assert [cell for cell in some if not cell.file("qlearning.csv").exists()] == [bad]
    sweep.learn_cells(some, workers=1)
    assert digests(study) == digests(tiny_study)


def test_what_a_killed_process_left_in_a_cell_is_removed(tiny_study, tmp_path):
    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    before = digests(copied)
    nobody = 999_999_999  # no process has this number
    for name in ("random/0", "extracted/1"):
        made = copied / "ablations" / "ball_collecting" / "actions" / name / "qlearning.csv"
        made.rename(made.with_name(f".{made.name}.{nobody}.part"))
    sweep.learn_cells(begin_cells(copied, "actions"), workers=1)
    assert digests(copied) == before


def test_more_runs_and_sources_leave_cells_as_they_are(tiny_study, tmp_path, tiny_run):
    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    second = copied / "ball_collecting" / "B-0"
    other = runs.create(second, replace(tiny_run.settings, source="B"))
    for name in ("actions.npz", "sensors.npz"):
        shutil.copy(tiny_run.file(name), second / name)
    record_all(other)
    cells = begin_cells(copied, "actions", n_runs=3)
    evolved = {(cell.settings.condition, cell.settings.seed): run.folder.name for cell, run in cells.items()}
    assert {evolved["human", seed] for seed in range(TINY_SWEEP["n_runs"])} == {"A-0"}
    assert evolved["human", 2] == "A-0"
    assert (
        begin_cells(copied, "actions", n_runs=4)[
            runs.load(copied / "ablations/ball_collecting/actions/human/3", CellSettings)
        ].settings.source
        == "B"
    )


def test_new_cells_start_from_the_runs_that_are_named(tiny_study, tmp_path, tiny_run):
    copied = tmp_path / "study"
    shutil.copytree(tiny_study, copied)
    shutil.copytree(copied / "ball_collecting" / "A-0", copied / "ball_collecting" / "A-1")
    cells = begin_cells(copied, "actions", n_runs=4, only=["A-1"])
    evolved = {(cell.settings.condition, cell.settings.seed): run.folder.name for cell, run in cells.items()}
    assert [evolved["random", seed] for seed in range(4)] == ["A-0", "A-0", "A-1", "A-1"]
    with pytest.raises(RunError, match=r"has no run B-9 of ball_collecting .* choose some of A-0, A-1"):
        begin_cells(copied, "actions", n_runs=4, only=["A-0", "B-9"])


def test_what_two_experiments_have_in_common_is_learned_once(tiny_study, tmp_path):
    """Human actions with human sensors, and extracted actions in their own number with human sensors."""
    both = [folders.find(tiny_study, "ball_collecting", what) for what in WHATS]
    assert both[0]["human"] == both[1]["human"] and both[0]["extracted"] == both[2]["17"]
    folder = tiny_study / "ablations" / "ball_collecting"
    names = {what: {path.name for path in (folder / what).iterdir() if path.is_dir()} for what in WHATS}
    assert names["sensors"] == {"instant", "selected", "random", "random+"}
    assert names["n_actions"] == {"4", "8", "30", "50"}
    assert [is_shared(BALL, Place("actions", name)) for name in names["actions"] - {"random"}] == [True, True]
    assert not is_shared(BALL, Place("actions", "random"))


def test_a_common_cell_does_not_depend_on_whom_it_is_made_for(tiny_study, tmp_path):
    copied = tmp_path / "study"
    shutil.copytree(tiny_study / "ball_collecting", copied / "ball_collecting")
    of_sensors = begin_cells(copied, "sensors")
    human = {cell: run for cell, run in of_sensors.items() if cell.settings.what == "actions"}
    assert {cell.settings.condition for cell in human} == {"human"} and len(human) == 2
    sweep.learn_cells(human, workers=1)
    where = "ablations/ball_collecting/actions/human"
    assert digests(copied / where) == digests(tiny_study / where)
    assert (
        folders.find(copied, "ball_collecting", "actions") == folders.find(copied, "ball_collecting", "sensors") == {}
    )
    sweep.learn_cells(of_sensors, workers=1)
    assert digests(copied / where) == digests(tiny_study / where)
    assert list(folders.find(copied, "ball_collecting", "sensors")) == list(conditions(BALL, "sensors"))


def test_a_common_cell_may_have_learned_longer(tiny_study, tmp_path):
    """The paper's last experiment has half the episodes of the first."""
    copied = tmp_path / "study"
    shutil.copytree(tiny_study / "ball_collecting", copied / "ball_collecting")
    begin_cells(copied, "actions", n_episodes=5)
    episodes = {cell.settings.condition: cell.settings.episodes for cell in begin_cells(copied, "n_actions")}
    assert episodes == {"extracted": 5, "4": 3, "8": 3, "30": 3, "50": 3}
    with pytest.raises(RunError, match="episodes = 5, not 6"):
        begin_cells(copied, "sensors", n_episodes=6)


def test_cells_begun_with_other_settings_are_refused(tiny_study):
    with pytest.raises(RunError, match="lanes = 1, not 5"):
        begin_cells(tiny_study, "sensors", lanes=5)


def short_of_segments(tiny_study, tmp_path, monkeypatch, n):
    """A study without cells, whose run has `n` segments."""
    copied = tmp_path / "study"
    shutil.copytree(tiny_study / "ball_collecting", copied / "ball_collecting")
    run = runs.load(copied / "ball_collecting" / "A-0")
    arrays = files.read_npz(run.file("actions.npz"))
    files.write_npz(run.file("actions.npz"), arrays | {"n_segments": np.array(n)})
    record_all(run)
    few = Segments(*(field[:n] for field in segments.segments_of(run)))
    monkeypatch.setattr(segments, "segments_of", lambda run: few)
    monkeypatch.setattr(folders, "segments_of", lambda run: few)
    return copied


def test_a_number_of_actions_above_the_segments_is_left_out_and_said(tiny_study, tmp_path, monkeypatch, capsys):
    study = short_of_segments(tiny_study, tmp_path, monkeypatch, 20)
    cells = begin_cells(study, "n_actions")
    assert [cell.settings.condition for cell in cells] == ["4"] * 2 + ["8"] * 2 + ["extracted"] * 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("qboot: ")]
    words = f"actions take as many segments, and the traces of {study / 'ball_collecting' / 'A-0'} have 20: more"
    assert [line.partition(" is left out: ")[0] for line in said] == [
        "qboot: ball_collecting n_actions 30",
        "qboot: ball_collecting n_actions 50",
    ]
    assert f"30 {words}" in said[0] and f"50 {words}" in said[1]
    names = {path.name for path in (study / "ablations" / "ball_collecting" / "n_actions").iterdir()}
    assert names == {"4", "8"}
    sweep.learn_cells(cells, workers=1)
    assert list(folders.find(study, "ball_collecting", "n_actions")) == ["4", "8", "17"]
    listed = folders.faults(study, "ball_collecting", "n_actions")
    assert len(listed) == 2 and f"no cells of n_actions 30: 30 {words}" in listed[0]
    text = page.write(study).read_text()
    assert f"no cells of n_actions 50: 50 {words}" in text


def test_an_experiment_that_is_impossible_leaves_nothing(tiny_study, tmp_path, monkeypatch):
    study = short_of_segments(tiny_study, tmp_path, monkeypatch, 3)
    monkeypatch.setattr(
        folders, "places", lambda task, what: {"8": Place("n_actions", "8"), "30": Place("n_actions", "30")}
    )
    with pytest.raises(RunError, match=r"n_actions 8 is left out: 8 actions .*; .*n_actions 30 is left out: 30 "):
        begin_cells(study, "n_actions")
    assert not (study / "ablations").exists()


def test_in_doubt_segments_are_counted(tiny_run, monkeypatch):
    """What is recorded is their number before long ones are cut, or dropped."""
    some = Segments(np.zeros((3, 1)), np.zeros((3, 1)), np.array([250, 90, 100]))
    monkeypatch.setattr(segments, "segments_of", lambda run: some)
    monkeypatch.setattr(segments, "recorded_number", lambda run: 3)

    def shortage(n_actions, long_segments):
        actions = replace(tiny_run.settings.actions, long_segments=long_segments)
        return segments.shortage(replace(tiny_run, settings=replace(tiny_run.settings, actions=actions)), n_actions)

    assert [bool(shortage(n, "cut")) for n in (3, 5, 6)] == [False, False, True]
    assert [bool(shortage(n, "clip")) for n in (3, 4)] == [False, True]
    assert [bool(shortage(n, "drop")) for n in (2, 3)] == [False, True]


def test_padding_is_what_does_nothing(tiny_study):
    found = folders.find(tiny_study, "ball_collecting", "sensors")
    cells = [replace(long(cell), settings=replace(long(cell).settings, lanes=2)) for cell in found["random"]]
    shape = shapes.shapes_of(cells)[cells[0]]
    largest = max(int(read_selection(cell).sum()) for cell in cells)
    assert largest <= shape.n_inputs < largest + 16
    for cell in cells:
        problem = sweep.problem_of(cell, shape)
        assert problem.inputs.mask.sum() == read_selection(cell).sum()
        assert problem.actions.durations.shape == (shape.n_actions,)
        assert jax.tree.leaves(problem.domains)[0].shape[0] == 2
