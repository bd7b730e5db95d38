"""The table of jobs of a study: who makes what, who waits for whom, what is done."""

import shutil
from pathlib import Path

import pytest
from conftest import make_anew, tiny_settings

from qboot.envs.registry import BUILT_IN, get_task
from qboot.study import jobs
from qboot.study.controls import cells
from qboot.study.controls.conditions import places
from qboot.study.pipeline.table import STAGES
from qboot.study.store import runs


@pytest.mark.parametrize("profile", ["smoke", "quick", "standard", "paper"])
def test_every_file_is_made_by_one_job_and_needed_by_later_ones_alone(profile, tmp_path):
    made = set()
    for job in jobs.jobs_of(profile, None, tmp_path):
        assert set(job.needs) <= made, job.label
        assert job.makes and made.isdisjoint(job.makes), job.label
        made.update(job.makes)
    assert all(path.is_relative_to(tmp_path) for path in made)


def test_the_table_of_the_smallest_study(tmp_path):
    table = jobs.jobs_of("smoke", None, tmp_path)
    assert len(table) == len(BUILT_IN) * (4 + 3)
    by_label = {job.label: job for job in table}
    assert len(by_label) == len(table)
    evolve, extract = by_label["ball_collecting A-0 evolve"], by_label["ball_collecting A-0 extract"]
    out = str(tmp_path / "ball_collecting" / "A-0")
    begin = "--task ball_collecting --profile smoke --source A --seed 0"
    assert " ".join(evolve.arguments) == f"evolve {begin} --out {out}"
    assert " ".join(extract.arguments) == f"extract --out {out}"
    control = by_label["box_pushing n_actions"]
    assert " ".join(control.arguments) == (
        f"ablate --task box_pushing --what n_actions --profile smoke --out {tmp_path}"
    )
    # Two learners of each number of actions that every run can give; those with the run's own are made by another
    # experiment, and for larger numbers a run may have too few segments.
    numbers = [path.parts[-3] for path in control.makes]
    assert numbers == ["3", "3", "5", "5"]
    assert tmp_path / "ablations" / "box_pushing" / "n_actions" / "5" / "1" / "qlearning.csv" in control.makes
    waits = {each.label for each in jobs.waits_for(control, table)}
    assert waits == {"box_pushing A-0 evolve", "box_pushing A-0 extract", "box_pushing actions"}
    assert jobs.waits_for(evolve, table) == []


def test_a_control_experiment_waits_for_all_runs_of_its_task(tmp_path):
    table = jobs.jobs_of("quick", "ball_collecting", tmp_path)
    control = next(job for job in table if job.step == jobs.ABLATE)
    assert {job.what for job in jobs.waits_for(control, table)} == {"A-0", "B-0"}


def test_a_job_is_done_when_all_that_it_makes_is_there(tiny_study):
    table = jobs.jobs_of("smoke", "ball_collecting", tiny_study)
    stages = [job._replace(run=tiny_settings()) for job in table if job.run]
    assert [job.step for job in stages if job.is_done] == [stage.name for stage in STAGES]
    elsewhere = jobs.jobs_of("smoke", "box_pushing", tiny_study)
    assert not any(job.is_done for job in elsewhere)


def test_a_control_experiment_is_done_with_its_last_cell(tiny_study, tmp_path, tiny_sweep):
    shutil.copytree(tiny_study / "ball_collecting", tmp_path / "ball_collecting")
    control = jobs.jobs_of("smoke", "ball_collecting", tmp_path)[-1]
    table = places(get_task("ball_collecting"), control.what)
    folders = [cells.folder_of(tmp_path, "ball_collecting", place.what) / place.condition for place in table.values()]
    files = [folder / seed / "qlearning.csv" for folder in folders for seed in ("0", "1")]
    assert set(control.makes) < set(files)
    for path in files:
        assert not control.is_done
        shutil.copytree(tiny_study / path.parent.relative_to(tmp_path), path.parent)
    assert control.is_done
    content = files[0].read_bytes()
    files[0].write_bytes(content[:-9])
    assert not control.is_done
    files[0].write_bytes(content)
    make_anew(runs.load(tmp_path / "ball_collecting" / "A-0"))
    assert not control.is_done


def test_numbers_of_actions_that_a_run_cannot_give_are_not_waited_for(tiny_study, tmp_path, monkeypatch, tiny_sweep):
    shutil.copytree(tiny_study, tmp_path, dirs_exist_ok=True)
    control = jobs.jobs_of("smoke", "ball_collecting", tmp_path)[-1]
    assert control.is_done
    shutil.rmtree(control.folder / "50")
    assert not control.is_done
    monkeypatch.setattr(cells, "shortage", lambda run, n: "too few" if n > 30 else "")
    assert control.is_done


def test_a_task_in_a_file_has_one_name_in_all_jobs(tmp_path, monkeypatch):
    """The dry run measures this machine once for each name."""
    examples = Path(__file__).parents[1] / "examples"
    monkeypatch.chdir(examples)
    table = jobs.jobs_of("smoke", "point_robot.py:TASK", tmp_path)
    assert {job.task for job in table} == {f"{examples / 'point_robot.py'}:TASK"}


def test_unknown_words_are_refused(tmp_path):
    with pytest.raises(ValueError, match="unknown profile"):
        jobs.jobs_of("huge", None, tmp_path)


def test_a_study_runs_on_the_physics_that_was_asked_for(tmp_path):
    table = jobs.jobs_of("smoke", "box_pushing", tmp_path, "kinematic")
    assert {job.run.physics for job in table if job.run} == {"kinematic"}
    assert table[0].arguments[9:11] == ("--physics", "kinematic")
    assert "--physics" not in jobs.jobs_of("smoke", "box_pushing", tmp_path, "mjx")[0].arguments
    with pytest.raises(ValueError, match="choose one of mjx, kinematic"):
        jobs.jobs_of("smoke", "box_pushing", tmp_path, "fastsim")
    with pytest.raises(ValueError, match="--physics kinematic without --task"):
        jobs.jobs_of("smoke", None, tmp_path, "kinematic")
