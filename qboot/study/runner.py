"""Running a study: stages as processes of their own, spread over the cores, retried, skipped when done."""

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
from qboot.study.files import RunError
from qboot.study.progress import STATUS_VARIABLE

STAGES = ("evolve", "extract", "learn", "transfer")
# A stage that fails is run once more: it may have been killed for memory.
TRIES = 2
# One thread per process: the cores are busy with other runs.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass
class Worker:
    """One run in the making, as the display shows it."""

    label: str
    status: Path
    folder: Path


def reproduce(profile: str, task: str | None, out: Path, jobs: int | None) -> None:
    """All runs of one task or of all, into `out`/TASK/SOURCE-SEED.

    Raises:
        ValueError: for an unknown task or profile, or jobs below 1.
        RunError: if a run failed; the others have gone on.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs is {jobs}: at least 1 process is needed")
    settings = [run for name in ([task] if task else TASKS) for run in profiles.runs_of(name, profile)]
    folders = [out / run.task / f"{run.source}-{run.seed}" for run in settings]
    for folder, run in zip(folders, settings, strict=True):
        runs.create(folder, run)
    with tempfile.TemporaryDirectory() as scratch:
        workers = [
            Worker(f"{run.task} {run.source}-{run.seed}", Path(scratch) / f"{i}.json", folder)
            for i, (run, folder) in enumerate(zip(settings, folders, strict=True))
        ]
        with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
            futures = [pool.submit(_run_stages, worker) for worker in workers]
            _watch(workers, futures)
        errors = [f"{w.folder}: {f.result()}" for w, f in zip(workers, futures, strict=True) if f.result()]
    if errors:
        raise RunError("; ".join(errors))


def _run_stages(worker: Worker) -> str:
    """All stages of one run; an error in words, or nothing."""
    environment = os.environ | ONE_THREAD | {STATUS_VARIABLE: str(worker.status)}
    environment.setdefault("JAX_COMPILATION_CACHE_DIR", str(worker.folder.parents[1] / ".jax_cache"))
    environment.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    for stage in STAGES:
        command = [sys.executable, "-m", "qboot.cli", stage, "--out", str(worker.folder)]
        for _ in range(TRIES):
            started = time.time()
            result = subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
            if result.returncode == 0:
                _note_time(worker.folder, stage, time.time() - started)
            if result.returncode in (0, 2):
                break
        if result.returncode:
            words = result.stderr.strip().splitlines() or [f"exit code {result.returncode}"]
            return f"{stage} failed: {words[-1]}"
    return ""


def _note_time(folder: Path, stage: str, seconds: float) -> None:
    """Add a line to the run's record of wall time: one per start of a stage that did something or found it done."""
    with (folder / "timing.csv").open("a") as stream:
        stream.write(f"{stage},{seconds:.1f}\n")


def _watch(workers: list[Worker], futures: list) -> None:
    """Show how far all runs are until they are over."""
    total = len(workers) * len(STAGES)
    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
    with tqdm(total=float(total), desc="study", bar_format=form, dynamic_ncols=True, mininterval=1.0) as bar:
        while True:
            over = all(future.done() for future in futures)
            done, texts = 0.0, []
            for worker, future in zip(workers, futures, strict=True):
                status = _read_status(worker.status)
                if future.done():
                    done += len(STAGES)
                elif status:
                    stage = next(
                        (i for i, name in enumerate(STAGES) if status["label"].startswith(name)),
                        len(STAGES) - 1,
                    )
                    done += stage + status["done"] / max(status["total"], 1)
                    texts.append(f"{status['label']} {status['done']}/{status['total']} {status['text']}")
            bar.set_postfix_str(" | ".join(texts), refresh=False)
            bar.update(done - bar.n)
            if over:
                return
            time.sleep(1.0 if sys.stderr.isatty() else 10.0)


def _read_status(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
