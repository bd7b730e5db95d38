"""The command line: bad input gets one line and exit code 2, and leaves nothing behind."""

import os
import re
import subprocess
import sys

import pytest

import qboot
from qboot.cli import main


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evolve", "--task", "flying"], "unknown task 'flying': choose one of ball_collecting, box_pushing"),
        (["evolve", "--task", "ball_collecting", "--source", "D"], "unknown source 'D'"),
        (["evolve", "--task", "ball_collecting", "--profile", "huge"], "unknown profile 'huge'"),
        (["evolve", "--task", "ball_collecting", "--seed", "-1"], "seed is -1"),
        (["evolve", "--task", "ball_collecting", "--workers", "0"], "--workers is 0"),
        (["evolve", "--task", "ball_collecting", "--evolution.population", "-5"], "population"),
        (["evolve", "--task", "ball_collecting", "--evolution.populaton", "5"], "populaton"),
        (["evolve", "--task", "ball_collecting", "--physics", "foo"], "unknown physics 'foo' of ball_collecting"),
        (["evolve", "--task", "ball_collecting", "--dnn.n-inputs", "5"], "n_inputs is 5, but ball_collecting has 13"),
        (["evolve", "--task", "ball_collecting", "--sensors.lags", "13"], "sensors.lags is 13, but the learner"),
        (["evolve", "--out", "nowhere"], "start one with `qboot evolve --task TASK --out nowhere`"),
        (["learn"], "--out"),
        (["learn", "--out", "nowhere"], "no run folder"),
        (["learn", "--out", "nowhere", "--seed", "3"], "without --task"),
        (["reproduce", "--profile", "huge"], "unknown profile"),
        (["reproduce", "--task", "flying"], "unknown task"),
        (["reproduce", "--jobs", "0"], "--jobs is 0"),
        (["ablate", "--task", "flying"], "unknown task 'flying'"),
        (["ablate", "--task", "box_pushing", "--what", "colours"], "unknown experiment 'colours'"),
        (["ablate", "--task", "box_pushing", "--what", "actions", "colours"], "unknown experiment 'colours'"),
        (["ablate", "--task", "box_pushing", "--runs", "0"], "runs is 0"),
        (["ablate", "--task", "box_pushing", "--out", "nowhere"], "no run of box_pushing"),
        (["report", "--out", "nowhere"], "nowhere"),
        (["replay", "--out", "nowhere"], "no run folder"),
        (["report", "--out", "x", "--colour", "red"], "--colour"),
    ],
)
def test_bad_input_is_named(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(arguments)
    except SystemExit as exit:  # from the parsers of arguments
        code = exit.code
    assert code == 2
    output = capsys.readouterr()
    assert words in output.err + output.out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="permissions of folders are those of POSIX")
def test_no_write_access_is_named(tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert main(["evolve", "--task", "ball_collecting", "--profile", "smoke", "--out", str(blocked / "run")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_help_teaches_and_is_quick_to_import():
    code = "import sys, qboot.cli; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    result = subprocess.run([sys.executable, "-m", "qboot.cli", "--help"], capture_output=True, text=True, check=True)
    assert "qboot evolve   --task ball_collecting" in result.stdout
    stage = subprocess.run(
        [sys.executable, "-m", "qboot.cli", "evolve", "--help"], capture_output=True, text=True, check=True
    )
    assert "--evolution.population" in stage.stdout and "--seed" in stage.stdout


@pytest.mark.parametrize("command", ["evolve", "extract", "learn", "transfer", "ablate", "plot", "report", "reproduce"])
def test_help_names_each_option_once(command, capsys):
    with pytest.raises(SystemExit) as exit:
        main([command, "--help"])
    assert exit.value.code == 0
    named = re.findall(r"^[│ ]*((?:-h, )?--[a-z][a-z.-]*)", capsys.readouterr().out, re.M)
    assert "-h, --help" in named and "--out" in named
    assert len(named) == len(set(named))


def test_help_shows_the_defaults_that_will_be_used(capsys):
    for profile, generations in (("quick", 40), ("standard", 400)):
        with pytest.raises(SystemExit):
            main(["evolve", "--task", "box_pushing", "--profile", profile, "--help"])
        words = " ".join(re.sub("[│╰─╯]", " ", capsys.readouterr().out).split())
        assert re.search(rf"--evolution.generations INT [^-]*\(default: {generations}\)", words)


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as exit:
        main(["--version"])
    assert exit.value.code == 0
    assert capsys.readouterr().out == f"qboot {qboot.__version__}\n"


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a closed pipe is another error")
def test_a_reader_that_stops_early_is_no_error():
    reader, writer = os.pipe()
    os.close(reader)  # as `head` does when it has its lines
    command = [sys.executable, "-m", "qboot.cli", "evolve", "--help"]
    result = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert result.returncode == 141
    assert result.stderr == ""
