"""Running a study: stages as processes of their own, spread over the cores, retried, skipped when done."""

import contextlib
import itertools
import json
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from qboot.study import costs, processes
from qboot.study.jobs import Job, jobs_of, waits_for
from qboot.study.pipeline.checks import check
from qboot.study.pipeline.interruption import at_interrupt
from qboot.study.pipeline.progress import STATUS_VARIABLE
from qboot.study.store import lock, programs, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.settings import RunSettings

# A stage that fails is run once more: it may have been killed for memory.
TRIES = 2
SECONDS_BETWEEN_LOOKS = 0.5
# One thread per process: the cores are busy with others.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
# What a process says to its user, among all that libraries print: a line of qboot's, or a warning of Python's.
SAID = re.compile(r"(?:qboot|.+:\d+: \w*Warning): (.+)")


class Incomplete(RunError):
    """Runs or experiments of a study failed; the others are done."""


@dataclass
class Chain:
    """Steps to be done one after another, each a process of its own, which the display shows as one."""

    label: str
    status: Path
    folder: Path
    steps: dict[str, tuple[str, ...]]  # arguments of `qboot` by name of the step
    parts: dict[str, float] = field(default_factory=dict)  # what each part of the steps costs, by name, in their order
    before: float = 0.0  # of these costs, what earlier starts of the study have done
    is_ready: Callable[[], bool] = lambda: True  # whether what it reads is there
    is_over: bool = False
    error: str = ""  # in words, once it is over


def reproduce(profile: str, task: str | None, out: Path, jobs: int | None, physics: str | None = None) -> None:
    """All runs of one task or of all, into `out`/TASK/SOURCE-SEED, and their control experiments.

    Raises:
        ValueError: for an unknown task, profile or physics, or jobs below 1.
        Incomplete: if a run or an experiment failed; the others have gone on.
        RunError: if nothing could be begun.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs is {jobs}: at least 1 process is needed")
    table = jobs_of(profile, task, out, physics)
    settings = list(dict.fromkeys(each.run for each in table if each.run))
    for run in settings:
        check(run)
    programs.share(out)  # a study that is refused has no place for them
    unusable = _create(out, settings)
    with lock.owned(out), _scratch(out) as scratch, at_interrupt(processes.stop_all):
        status = (scratch / f"{i}.json" for i in itertools.count())
        # The stages of a run follow each other; a control experiment waits for the runs of its task.
        of_runs = [
            _of_run(list(stages), next(status))
            for run, stages in itertools.groupby((each for each in table if each.run), key=lambda each: each.run)
            if run not in unusable
        ]
        of_controls: dict[Job, Chain] = {}
        for each in table:
            if not each.run:
                # ... and for the experiment that makes the cells that it has in common with it.
                earlier = [of_controls[other] for other in waits_for(each, list(of_controls))]
                of_controls[each] = _of_control(each, next(status), of_runs, earlier)
        everything = [*of_runs, *of_controls.values()]
        do(everything, _do_steps, jobs or os.cpu_count() or 1)
    errors = [*unusable.values(), *(f"{chain.folder}: {chain.error}" for chain in everything if chain.error)]
    if errors:
        raise Incomplete("; ".join(errors))


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


def do(some: list[Chain], do_chain: Callable[[Chain], str], n_workers: int) -> None:
    """Do chains in their order, several at a time; one that is not ready lets others pass.

    Args:
        some: the chains; one that waits for others must become ready once they are over.
        do_chain: does one; returns its error, or nothing.
        n_workers: at a time, >= 1.
    """
    waiting, one_at_a_time = list(some), threading.Lock()

    def take() -> Chain | None:
        with one_at_a_time:
            chain = next((chain for chain in waiting if _is_ready(chain)), None)
            if chain:
                waiting.remove(chain)
            return chain

    def work() -> None:
        while waiting:
            chain = take()
            if chain is None:
                time.sleep(SECONDS_BETWEEN_LOOKS)
                continue
            try:
                chain.error = chain.error or do_chain(chain)
            except Exception as error:  # whatever it is: the others go on, and nobody waits for this one
                chain.error = _in_words(error)
            finally:
                chain.is_over = True

    with ThreadPoolExecutor(n_workers) as pool:
        workers = [pool.submit(work) for _ in range(n_workers)]
        try:
            _watch(some)
        except BaseException:
            processes.stop_all()  # what nobody watches any more
            raise
        finally:
            waiting.clear()
    for worker in workers:
        worker.result()


def _is_ready(chain: Chain) -> bool:
    """Whether a chain can begin; one that cannot tell has failed, and is taken to be over."""
    try:
        return chain.is_ready()
    except Exception as error:
        chain.error = f"cannot tell whether it can begin: {_in_words(error)}"
        return True


def _in_words(error: Exception) -> str:
    words = " ".join(str(error).split())
    return words if words and isinstance(error, OSError | RunError | ValueError) else f"{type(error).__name__} {words}"


def _of_run(stages: list[Job], status: Path) -> Chain:
    steps = {stage.step: stage.arguments for stage in stages}
    parts = {name: seconds for stage in stages for name, seconds in costs.of_usual(stage).items()}
    before = sum(sum(costs.of_usual(stage).values()) for stage in stages if stage.is_done)
    return Chain(f"{stages[0].task_name} {stages[0].what}", status, stages[0].folder, steps, parts, before)


def _of_control(control: Job, status: Path, of_runs: list[Chain], earlier: list[Chain]) -> Chain:
    """A control experiment, which begins when all runs of its task have their actions and sensors, or never will."""
    awaited = [chain for chain in of_runs if any(path.parent == chain.folder for path in control.needs)]

    def is_ready() -> bool:
        extracted = all(chain.is_over or _is_extracted(chain.folder) for chain in awaited)
        return extracted and all(chain.is_over for chain in earlier)

    steps, parts = {control.step: control.arguments}, costs.of_usual(control)
    before = sum(parts.values()) if control.is_done else 0.0
    return Chain(control.label, status, control.folder, steps, parts, before, is_ready)


def _is_extracted(folder: Path) -> bool:
    try:
        return provenance.is_whole(runs.load(folder), "sensors.npz")
    except RunError:
        return False


def _do_steps(chain: Chain) -> str:
    """All steps of one chain, whose warnings are shown; an error in words, or nothing."""
    environment = os.environ | ONE_THREAD | {STATUS_VARIABLE: str(chain.status)}
    for step, arguments in chain.steps.items():
        command = [sys.executable, "-m", "qboot.cli", *arguments]
        for _ in range(TRIES):
            started, before = time.time(), _read_status(chain.status)
            result = processes.run(command, environment)
            if result.returncode == 0 and _read_status(chain.status) != before:
                _note_time(chain.folder, step, time.time() - started)
            if result.returncode in (0, 2, 129, 130, 143):
                break
        lines = result.stderr.strip().splitlines()
        error = (lines or [f"exit code {result.returncode}"]).pop() if result.returncode else ""
        _show_warnings(lines, f"{chain.label} {step}")
        if error:
            return f"{step} failed: {error}"
    return ""


def _show_warnings(lines: list[str], label: str) -> None:
    """Say above the bar, once each, what a step has told its user."""
    for words in dict.fromkeys(said[1] for line in lines if (said := SAID.fullmatch(line))):
        tqdm.write(f"qboot: {label}: {words}", file=sys.stderr)


def _note_time(folder: Path, stage: str, seconds: float) -> None:
    """Add a line to the record of wall time: one per start of a step that had something left to do."""
    with (folder / "timing.csv").open("a") as stream:
        stream.write(f"{stage},{seconds:.1f}\n")


def _watch(some: list[Chain]) -> None:
    """Show how far all chains are, by what they cost, until they are over."""
    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
    interval = 1.0 if sys.stderr.isatty() else 10.0  # a file is not filled with bars
    look = {"bar_format": form, "dynamic_ncols": True, "mininterval": interval, "smoothing": 0}
    total = sum(sum(chain.parts.values()) for chain in some)
    with tqdm(total=total, initial=sum(chain.before for chain in some), desc="study", **look) as bar:
        while True:
            over = all(chain.is_over for chain in some)
            statuses = {chain.label: _read_status(chain.status) for chain in some}
            done = sum(_seconds_done(chain, statuses[chain.label]) for chain in some)
            running = [status for chain in some if (status := statuses[chain.label]) and not chain.is_over]
            texts = [f"{status['label']} {status['done']}/{status['total']} {status['text']}" for status in running]
            bar.set_postfix_str(" | ".join(texts), refresh=False)
            bar.update(done - bar.n)
            if over:
                return
            time.sleep(SECONDS_BETWEEN_LOOKS)


def _seconds_done(chain: Chain, status: dict | None) -> float:
    """How much of what a chain costs is done, given its last status."""
    names = list(chain.parts)
    if chain.is_over:
        return sum(chain.parts.values())
    part = status["label"].split()[0] if status else ""
    if status is None or part not in chain.parts:
        return chain.before
    done = sum(chain.parts[name] for name in names[: names.index(part)])
    return done + chain.parts[part] * status["done"] / max(status["total"], 1)


def _read_status(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
