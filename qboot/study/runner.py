"""Running a study: stages as processes of their own, spread over the cores, retried, skipped when done."""

import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from qboot.envs import TASKS
from qboot.study import profiles, runs
from qboot.study.ablations import WHATS
from qboot.study.files import RunError
from qboot.study.progress import STATUS_VARIABLE
from qboot.study.runs import RunSettings

STAGES = ("evolve", "extract", "learn", "transfer")
# A stage that fails is run once more: it may have been killed for memory.
TRIES = 2
SECONDS_BETWEEN_LOOKS = 0.5
# One thread per process: the cores are busy with others.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass
class Job:
    """Steps to be done one after another, each a process, as the display shows them."""

    label: str
    status: Path
    folder: Path
    steps: dict[str, list[str]]  # arguments of `qboot` by name of the step


def reproduce(profile: str, task: str | None, out: Path, jobs: int | None) -> None:
    """All runs of one task or of all, into `out`/TASK/SOURCE-SEED, then their control experiments.

    Raises:
        ValueError: for an unknown task or profile, or jobs below 1.
        RunError: if a run or an experiment failed; the others have gone on.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs is {jobs}: at least 1 process is needed")
    tasks = [task] if task else list(TASKS)
    settings = [run for name in tasks for run in profiles.runs_of(name, profile)]
    for run in settings:
        runs.create(_folder_of(out, run), run)
    with tempfile.TemporaryDirectory() as scratch:
        status = (Path(scratch) / f"{i}.json" for i in itertools.count())
        of_runs = [_run_job(out, run, next(status)) for run in settings]
        # Those of the slower simulation first, so that the cores are busy to the end.
        of_sweeps = [_sweep_job(out, name, what, profile, next(status)) for name in tasks[::-1] for what in WHATS]
        errors = _do(of_runs, "runs", out, jobs) + _do(of_sweeps, "control experiments", out, jobs)
    if errors:
        raise RunError("; ".join(errors))


def _folder_of(out: Path, run: RunSettings) -> Path:
    return out / run.task / f"{run.source}-{run.seed}"


def _run_job(out: Path, run: RunSettings, status: Path) -> Job:
    folder = _folder_of(out, run)
    steps = {stage: [stage, "--out", str(folder)] for stage in STAGES}
    return Job(f"{run.task} {run.source}-{run.seed}", status, folder, steps)


def _sweep_job(out: Path, task: str, what: str, profile: str, status: Path) -> Job:
    arguments = ["ablate", "--task", task, "--what", what, "--profile", profile, "--out", str(out)]
    return Job(f"{task} {what}", status, out / "ablations" / task / what, {"ablate": arguments})


def _do(some: list[Job], label: str, out: Path, jobs: int | None) -> list[str]:
    """Do jobs, several at a time; the errors in words."""
    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        futures = [pool.submit(_do_steps, job, out) for job in some]
        _watch(label, some, futures)
    return [f"{job.folder}: {future.result()}" for job, future in zip(some, futures, strict=True) if future.result()]


def _do_steps(job: Job, out: Path) -> str:
    """All steps of one job; an error in words, or nothing."""
    environment = os.environ | ONE_THREAD | {STATUS_VARIABLE: str(job.status)}
    environment.setdefault("JAX_COMPILATION_CACHE_DIR", str(out / ".jax_cache"))
    environment.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    for step, arguments in job.steps.items():
        command = [sys.executable, "-m", "qboot.cli", *arguments]
        for _ in range(TRIES):
            started = time.time()
            result = subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
            if result.returncode == 0:
                _note_time(job.folder, step, time.time() - started)
            if result.returncode in (0, 2):
                break
        if result.returncode:
            words = result.stderr.strip().splitlines() or [f"exit code {result.returncode}"]
            return f"{step} failed: {words[-1]}"
    return ""


def _note_time(folder: Path, stage: str, seconds: float) -> None:
    """Add a line to the run's record of wall time: one per start of a stage that did something or found it done."""
    with (folder / "timing.csv").open("a") as stream:
        stream.write(f"{stage},{seconds:.1f}\n")


def _watch(label: str, some: list[Job], futures: list) -> None:
    """Show how far all jobs are until they are over."""
    total = sum(len(job.steps) for job in some)
    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
    interval = 1.0 if sys.stderr.isatty() else 10.0  # a file is not filled with bars
    with tqdm(total=float(total), desc=label, bar_format=form, dynamic_ncols=True, mininterval=interval) as bar:
        while True:
            over = all(future.done() for future in futures)
            done, texts = 0.0, []
            for job, future in zip(some, futures, strict=True):
                status = _read_status(job.status)
                if future.done():
                    done += len(job.steps)
                elif status:
                    finished = [i for i, step in enumerate(job.steps) if status["label"].startswith(step)]
                    done += (finished or [len(job.steps) - 1])[0] + status["done"] / max(status["total"], 1)
                    texts.append(f"{status['label']} {status['done']}/{status['total']} {status['text']}")
            bar.set_postfix_str(" | ".join(texts), refresh=False)
            bar.update(done - bar.n)
            if over:
                return
            time.sleep(SECONDS_BETWEEN_LOOKS)


def _read_status(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
