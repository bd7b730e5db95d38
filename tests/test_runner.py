"""Running a study: order, waiting, errors; what the processes do is tested elsewhere."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from qboot import cli
from qboot.study import processes, runner
from qboot.study.controls.conditions import WHATS
from qboot.study.pipeline import progress
from qboot.study.pipeline.progress import STATUS_VARIABLE, Progress
from qboot.study.report import page
from qboot.study.runner import Chain
from qboot.study.store import programs
from qboot.study.store.files import RunError


def chain(label, **changed):
    return Chain(label, Path("nowhere"), Path(label), {"step": []}, **changed)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(runner, "SECONDS_BETWEEN_LOOKS", 0.01)


def test_a_job_that_is_not_ready_lets_others_pass():
    done = []
    first = chain("first")
    waits = chain("waits", is_ready=lambda: last.is_over)
    last = chain("last")

    def do_chain(some):
        done.append(some.label)
        return ""

    runner.do([first, waits, last], do_chain, n_workers=1)
    assert done == ["first", "last", "waits"]
    assert first.is_over and waits.is_over and last.is_over


def test_jobs_run_side_by_side():
    together = threading.Barrier(3, timeout=20)  # broken unless three are at work at once

    def do_chain(some):
        together.wait()
        return ""

    runner.do([chain(str(i)) for i in range(3)], do_chain, n_workers=3)


def test_an_error_stops_its_job_alone():
    def do_chain(some):
        if some.label == "1":
            raise OSError("no space")
        return "bad" if some.label == "0" else ""

    some = [chain(str(i)) for i in range(3)]
    runner.do(some, do_chain, n_workers=1)
    assert [each.error for each in some] == ["bad", "no space", ""]


@pytest.mark.parametrize("error", [PermissionError("locked"), KeyError("x"), RunError("gone")])
@pytest.mark.parametrize("n_workers", [1, 3])
def test_a_job_that_cannot_tell_whether_it_is_ready_fails_alone(error, n_workers):
    def is_ready():
        raise error

    some = [chain("0"), chain("1", is_ready=is_ready), chain("2", is_ready=lambda: some[1].is_over)]
    done = []
    runner.do(some, lambda each: done.append(each.label) or "", n_workers)
    assert sorted(done) == ["0", "2"] and all(each.is_over for each in some)
    assert [bool(each.error) for each in some] == [False, True, False]
    assert str(error) in some[1].error and "\n" not in some[1].error


def test_any_error_of_a_job_is_one_line_and_others_go_on():
    def do_chain(some):
        raise RuntimeError("two\nlines")

    some = [chain(str(i)) for i in range(3)]
    runner.do(some, do_chain, n_workers=1)
    assert [each.error for each in some] == ["RuntimeError two lines"] * 3


def test_what_nobody_watches_is_stopped(monkeypatch):
    """As when the reader of the progress goes away."""
    monkeypatch.setattr(processes, "_stopping", threading.Event())
    command = [sys.executable, "-c", "import time; time.sleep(600)"]

    def watch(some):
        while not processes._running:
            time.sleep(0.01)
        raise BrokenPipeError

    def do_chain(some):
        return str(processes.run(command, dict(os.environ)).returncode)

    monkeypatch.setattr(runner, "_watch", watch)
    some = [chain(str(i)) for i in range(2)]
    started = time.monotonic()
    with pytest.raises(BrokenPipeError):
        runner.do(some, do_chain, n_workers=1)
    assert time.monotonic() - started < 30
    assert not processes._running and some[0].error == str(-signal.SIGTERM)


def test_a_study_whose_jobs_cannot_be_judged_ends_with_one_line(tmp_path, monkeypatch, capsys):
    """The stages of its run go on until it is asked whether the first experiment can begin."""
    asked = threading.Event()

    def is_extracted(folder):
        asked.set()
        raise TypeError("unheard of")

    def run(command, environment):
        assert asked.wait(60)
        return subprocess.CompletedProcess(command, 2, "", "not today")

    monkeypatch.setattr(runner, "_is_extracted", is_extracted)
    monkeypatch.setattr(processes, "run", run)
    monkeypatch.setattr(programs, "share", lambda out: None)
    out = tmp_path / "study"
    command = ["reproduce", "--task", "ball_collecting", "--profile", "smoke", "--out", str(out), "--jobs", "2"]
    assert cli.main(command) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("qboot: ")]
    assert len(said) == 1 and "evolve failed: not today" in said[0]
    assert "actions: cannot tell whether it can begin: TypeError unheard of" in said[0]
    assert not (out / ".status").exists() and not (out / ".lock").exists()
    # There is a report on what there is, all the same.
    assert "A-0" in (out / "report.html").read_text()


@pytest.mark.parametrize("way", ["not begun", "no room for the report"])
def test_why_a_study_failed_is_told_before_anything_about_its_report(tmp_path, monkeypatch, capsys, way):
    def reproduce(*arguments):
        raise (RunError if way == "not begun" else runner.Incomplete)("evolve failed")

    def write(out):
        assert way != "not begun"
        raise RunError("no room")

    monkeypatch.setattr(runner, "reproduce", reproduce)
    monkeypatch.setattr(page, "write", write)
    assert cli.main(["reproduce", "--profile", "smoke", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == "qboot: evolve failed\n"


@pytest.mark.parametrize("code", [0, 2])
def test_what_a_step_tells_its_user_is_shown_once(monkeypatch, capsys, code):
    printed = (
        "extract:   0%|          | 0/3\rextract:  33%|###       | 1/3\n"
        "/a b/extracting.py:31: UserWarning: A-0: no extracted action gives gripper below 0.5\n"
        "  warnings.warn(f'{run.folder}: no extracted action gives {words}')\n"
        "WARNING:jax: an accelerator may be there\n"
        "qboot: actions.npz is damaged: set aside\n"
        "qboot: actions.npz is damaged: set aside\n"
        "qboot: the end\n"
    )
    monkeypatch.setattr(processes, "run", lambda command, _: subprocess.CompletedProcess(command, code, "", printed))
    error = runner._do_steps(chain("task A-0"))
    said = [
        "qboot: task A-0 step: A-0: no extracted action gives gripper below 0.5",
        "qboot: task A-0 step: actions.npz is damaged: set aside",
    ]
    if code:  # the last line is the error
        assert error == "step failed: qboot: the end"
    else:
        said.append("qboot: task A-0 step: the end")
    assert capsys.readouterr().err.splitlines() == said


def test_several_threads_report_into_one_file(tmp_path, monkeypatch):
    replace = os.replace

    def slow_replace(*paths):
        time.sleep(0.05)  # for another thread to come in between
        replace(*paths)

    monkeypatch.setenv(STATUS_VARIABLE, str(tmp_path / "status.json"))
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_REPORTS", -1.0)
    monkeypatch.setattr(progress.os, "replace", slow_replace)
    with Progress("ablate", "episode", total=4) as bar, ThreadPoolExecutor(4) as pool:
        assert list(pool.map(bar.update, range(1, 5))) == [None] * 4
    assert runner._read_status(tmp_path / "status.json")["label"] == "ablate"


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
