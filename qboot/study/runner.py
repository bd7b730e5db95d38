"""Running a study: stages as processes of their own, spread over the cores, retried, skipped when done."""

import contextlib
import itertools
import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import jax
from tqdm import tqdm

from qboot.envs.registry import BUILT_IN, get_task
from qboot.study import processes
from qboot.study.controls.cells import folder_of as folder_of_cells
from qboot.study.controls.conditions import WHATS
from qboot.study.pipeline import profiles
from qboot.study.pipeline.checks import check
from qboot.study.pipeline.interruption import at_interrupt
from qboot.study.pipeline.progress import STATUS_VARIABLE
from qboot.study.pipeline.table import STAGES
from qboot.study.store import lock, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.settings import RunSettings

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
    is_ready: Callable[[], bool] = lambda: True  # whether what it reads is there
    is_over: bool = False
    error: str = ""  # in words, once it is over


def reproduce(profile: str, task: str | None, out: Path, jobs: int | None) -> None:
    """All runs of one task or of all, into `out`/TASK/SOURCE-SEED, and their control experiments.

    Raises:
        ValueError: for an unknown task or profile, or jobs below 1.
        RunError: if a run or an experiment failed; the others have gone on.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs is {jobs}: at least 1 process is needed")
    tasks = [task] if task else list(BUILT_IN)
    settings = {name: profiles.runs_of(name, profile) for name in tasks}
    for run in itertools.chain(*settings.values()):
        check(run)
    unusable = _create(out, list(itertools.chain(*settings.values())))
    with lock.owned(out), _scratch(out) as scratch, at_interrupt(processes.stop_all):
        status = (scratch / f"{i}.json" for i in itertools.count())
        of_runs = {
            name: [_run_job(out, run, next(status)) for run in settings[name] if run not in unusable] for name in tasks
        }
        # Those of the slower simulation first, so that the cores are busy to the end.
        of_sweeps = [job for name in tasks[::-1] for job in _sweep_jobs(out, name, profile, status, of_runs[name])]
        everything = [job for of_task in of_runs.values() for job in of_task] + of_sweeps
        do(everything, lambda job: _do_steps(job), jobs or os.cpu_count() or 1)
    errors = [*unusable.values(), *(f"{job.folder}: {job.error}" for job in everything if job.error)]
    if errors:
        raise RunError("; ".join(errors))


def _create(out: Path, some: list[RunSettings]) -> dict[RunSettings, str]:
    """Begin all runs; why some cannot be, if others can.

    Raises:
        RunError: if none can be begun.
    """
    unusable = {}
    for run in some:
        try:
            runs.create(runs.folder_of(out, run), run)
        except RunError as error:
            unusable[run] = str(error)
    if len(unusable) == len(some):
        raise RunError(next(iter(unusable.values())))
    return unusable


@contextlib.contextmanager
def _scratch(out: Path) -> Iterator[Path]:
    """A folder for the time of a study; what a killed process left in it is removed."""
    folder = out / ".status"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def share_compiled_programs(out: Path) -> None:
    """Keep what this process and those that it starts compile in the folder of the study, unless told otherwise."""
    folder = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(out / ".jax_cache"))
    seconds = os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float(seconds))


def do(some: list[Job], do_job: Callable[[Job], str], n_workers: int) -> None:
    """Do jobs in their order, several at a time; one that is not ready lets others pass.

    Args:
        some: the jobs; a job that waits for others must become ready once they are over.
        do_job: does one; returns its error, or nothing.
        n_workers: at a time, >= 1.
    """
    waiting, one_at_a_time = list(some), threading.Lock()

    def take() -> Job | None:
        with one_at_a_time:
            job = next((job for job in waiting if job.is_ready()), None)
            if job:
                waiting.remove(job)
            return job

    def work() -> None:
        while waiting:
            job = take()
            if job is None:
                time.sleep(SECONDS_BETWEEN_LOOKS)
                continue
            try:
                job.error = do_job(job)
            except OSError as error:
                job.error = str(error)
            finally:
                job.is_over = True

    with ThreadPoolExecutor(n_workers) as pool:
        workers = [pool.submit(work) for _ in range(n_workers)]
        try:
            _watch(some)
        finally:
            waiting.clear()
    for worker in workers:
        worker.result()


def _run_job(out: Path, run: RunSettings, status: Path) -> Job:
    folder = runs.folder_of(out, run)
    steps = {stage.name: [stage.name, "--out", str(folder)] for stage in STAGES}
    return Job(f"{get_task(run.task).name} {run.source}-{run.seed}", status, folder, steps)


def _sweep_jobs(out: Path, task: str, profile: str, status: Iterator[Path], of_runs: list[Job]) -> list[Job]:
    """The control experiments of a task, which begin when all its runs have their actions and sensors, or never will.

    The first one is done before the others, for it makes the cells that they have in common with it.
    """
    name = get_task(task).name
    found: list[Job] = []
    for what in WHATS:
        arguments = ["ablate", "--task", task, "--what", what, "--profile", profile, "--out", str(out)]

        def is_ready(before: tuple[Job, ...] = tuple(found[:1])) -> bool:
            extracted = all(job.is_over or _is_extracted(job.folder) for job in of_runs)
            return extracted and all(job.is_over for job in before)

        folder = folder_of_cells(out, name, what)
        found.append(Job(f"{name} {what}", next(status), folder, {"ablate": arguments}, is_ready))
    return found


def _is_extracted(folder: Path) -> bool:
    try:
        return provenance.is_whole(runs.load(folder), "sensors.npz")
    except RunError:
        return False


def _do_steps(job: Job) -> str:
    """All steps of one job; an error in words, or nothing."""
    environment = os.environ | ONE_THREAD | {STATUS_VARIABLE: str(job.status)}
    for step, arguments in job.steps.items():
        command = [sys.executable, "-m", "qboot.cli", *arguments]
        for _ in range(TRIES):
            started, before = time.time(), _read_status(job.status)
            result = processes.run(command, environment)
            if result.returncode == 0 and _read_status(job.status) != before:
                _note_time(job.folder, step, time.time() - started)
            if result.returncode in (0, 2, 129, 130, 143):
                break
        if result.returncode:
            words = result.stderr.strip().splitlines() or [f"exit code {result.returncode}"]
            return f"{step} failed: {words[-1]}"
    return ""


def _note_time(folder: Path, stage: str, seconds: float) -> None:
    """Add a line to the record of wall time: one per start of a step that had something left to do."""
    with (folder / "timing.csv").open("a") as stream:
        stream.write(f"{stage},{seconds:.1f}\n")


def _watch(some: list[Job]) -> None:
    """Show how far all jobs are until they are over."""
    total = sum(len(job.steps) for job in some)
    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
    interval = 1.0 if sys.stderr.isatty() else 10.0  # a file is not filled with bars
    with tqdm(total=float(total), desc="study", bar_format=form, dynamic_ncols=True, mininterval=interval) as bar:
        while True:
            over = all(job.is_over for job in some)
            done, texts = 0.0, []
            for job in some:
                status = _read_status(job.status)
                if job.is_over:
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
