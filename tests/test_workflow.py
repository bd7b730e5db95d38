"""The workflow for clusters: the same jobs as `qboot reproduce`, and Slurm's words."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from qboot import cli
from qboot.study import jobs, workflow
from qboot.study.workflow.slurm_status import status_of


def test_snakemake_plans_a_rule_for_each_job(tmp_path):
    pytest.importorskip("snakemake", reason="the extra `cluster` is not installed")
    out = tmp_path / "a study"
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(workflow.SNAKEFILE), "--dry-run", "--cores", "2"]
    config = ["--printshellcmds", "--config", "profile=quick", "task=ball_collecting", f"out={out}"]
    result = subprocess.run([*command, *config], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    words = [shlex.split(line) for line in (result.stdout + result.stderr).splitlines() if "QBOOT_STATUS=" in line]
    assert len(words) == len(jobs.jobs_of("quick", "ball_collecting", out))
    for line in words:
        log = line[-2]
        assert Path(log).parent == out / "logs" and f"QBOOT_STATUS={log}.status" in line
    stats = (result.stdout + result.stderr).rpartition("Job stats:")[2].partition("Reasons:")[0]
    counted = dict(line.rsplit(maxsplit=1) for line in stats.splitlines() if line.strip() and line[0].isalpha())
    assert {name: int(n) for name, n in counted.items() if name not in ("job", "total", "all", "report")} == {
        **dict.fromkeys(("evolve", "extract", "learn", "transfer"), 2),
        **{f"ball_collecting_{what}": 1 for what in ("actions", "sensors", "n_actions")},
    }
    assert int(counted["total"]) == len(jobs.jobs_of("quick", "ball_collecting", out)) + 2
    assert not out.exists()


def test_snakemake_refuses_a_folder_that_it_would_take_for_wildcards(tmp_path):
    pytest.importorskip("snakemake", reason="the extra `cluster` is not installed")
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(workflow.SNAKEFILE), "--dry-run", "--cores", "1"]
    result = subprocess.run([*command, "--config", "out=a{b}"], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode != 0
    assert "out=a{b}: Snakemake takes braces for wildcards" in result.stdout + result.stderr


def test_the_command_line_tells_where_the_workflow_is(capsys):
    assert cli.main(["workflow"]) == 0
    assert capsys.readouterr().out.strip() == str(workflow.SNAKEFILE)
    assert workflow.SNAKEFILE.exists()


@pytest.mark.parametrize(
    ("description", "status"),
    [
        ("JobId=7 JobName=evolve JobState=PENDING Reason=Resources", "running"),
        ("JobId=7 JobName=evolve JobState=RUNNING Reason=None", "running"),
        ("JobId=7 JobName=evolve JobState=COMPLETED Reason=None", "success"),
        ("JobId=7 JobName=evolve JobState=FAILED Reason=NonZeroExitCode", "failed"),
        ("JobId=7 JobName=evolve JobState=NODE_FAIL Reason=None", "failed"),
        ("JobId=7 JobName=evolve JobState=CANCELLED Reason=None", "failed"),
        ("", "success"),  # forgotten: its files tell
    ],
)
def test_what_slurm_says_of_a_job(description, status):
    assert status_of(description) == status
