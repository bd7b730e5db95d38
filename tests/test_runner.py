"""Running a study: order, waiting, errors; what the processes do is tested elsewhere."""

import itertools
import json
import sys
import threading
from pathlib import Path

import pytest

from qboot.study import processes, runner
from qboot.study.controls.conditions import WHATS
from qboot.study.pipeline.progress import STATUS_VARIABLE
from qboot.study.runner import Job
from qboot.study.store.files import RunError


def job(label, **changed):
    return Job(label, Path("nowhere"), Path(label), {"step": []}, **changed)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(runner, "SECONDS_BETWEEN_LOOKS", 0.01)


def test_a_job_that_is_not_ready_lets_others_pass():
    done = []
    first = job("first")
    waits = job("waits", is_ready=lambda: last.is_over)
    last = job("last")

    def do_job(some):
        done.append(some.label)
        return ""

    runner.do([first, waits, last], do_job, n_workers=1)
    assert done == ["first", "last", "waits"]
    assert first.is_over and waits.is_over and last.is_over


def test_jobs_run_side_by_side():
    together = threading.Barrier(3, timeout=20)  # broken unless three are at work at once

    def do_job(some):
        together.wait()
        return ""

    runner.do([job(str(i)) for i in range(3)], do_job, n_workers=3)


def test_an_error_stops_its_job_alone():
    def do_job(some):
        if some.label == "1":
            raise OSError("no space")
        return "bad" if some.label == "0" else ""

    some = [job(str(i)) for i in range(3)]
    runner.do(some, do_job, n_workers=1)
    assert [each.error for each in some] == ["bad", "no space", ""]


def test_experiments_wait_for_the_cells_that_they_have_in_common(tmp_path):
    """Two processes never learn in the same cell: the first experiment makes those that others have too."""
    status = (tmp_path / f"{i}.json" for i in itertools.count())
    first, *others = runner._sweep_jobs(tmp_path, "ball_collecting", "smoke", status, [])
    assert first.is_ready() and len(others) == 2 and not any(job.is_ready() for job in others)
    first.is_over = True
    assert all(job.is_ready() for job in others)


def test_a_study_runs_its_stages_then_its_experiments(tmp_path, monkeypatch):
    """The processes are stand-ins that write down their arguments; one run fails after it was extracted."""
    calls = tmp_path / "calls.txt"
    script = tmp_path / "stand_in.py"
    script.write_text(
        "import json, os, pathlib, sys\n"
        f"with open({str(calls)!r}, 'a') as stream: print(*sys.argv[3:], file=stream)\n"
        "if sys.argv[3] == 'learn': sys.exit('out of luck')\n"
        "status = {'label': sys.argv[3], 'done': 1, 'total': 1, 'text': ''}\n"
        f"if sys.argv[3] != 'extract': pathlib.Path(os.environ[{STATUS_VARIABLE!r}]).write_text(json.dumps(status))\n"
        "out = pathlib.Path(sys.argv[-1])\n"
        "if sys.argv[3] == 'extract': (out / 'sensors.npz').touch()\n"
    )
    real = processes.run

    def stand_in(command, environment):
        return real([sys.executable, script, *command[1:]], environment)

    monkeypatch.setattr(processes, "run", stand_in)
    out = tmp_path / "study"
    for what in WHATS:
        (out / "ablations" / "ball_collecting" / what).mkdir(parents=True)
    with pytest.raises(RunError, match="A-0: learn failed: out of luck"):
        runner.reproduce("smoke", "ball_collecting", out, jobs=1)
    named = [line.split()[0] for line in calls.read_text().splitlines()]
    # A stage that fails is tried twice; the experiments go on with what there is.
    assert named == ["evolve", "extract", "learn", "learn", "ablate", "ablate", "ablate"]
    folder = out / "ball_collecting" / "A-0"
    assert json.loads((folder / "config.json").read_text())["settings"]["profile"] == "smoke"
    # Wall time is that of the stages that did something.
    assert [line.split(",")[0] for line in (folder / "timing.csv").read_text().split()] == ["evolve"]
