"""What is published of a study: the small files behind its numbers and its figures of scores, with checksums.

Q-networks are left out, which are large, and columns that no figure needs; `qboot report` and `experiments/results.py`
read the copy as they read a study. Evolved networks are small: what they did is played again from the copy, and a run
can be gone on with from it. Figures that need Q-networks say that they are missing.
"""

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from qboot.study.store import files, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import AnyRun
from qboot.study.store.settings import CellSettings

CHECKSUMS = "SHA256SUMS"
_LEARNING = ("episode", "score", "steps")
# Columns or arrays that are kept of each file; None for the whole file. Configurations and times are copied too.
CONTENTS: Mapping[str, tuple[str, ...] | None] = {
    "history.csv": ("generation", "episodes", "best"),
    "qlearning.csv": _LEARNING,
    "generalisation.csv": None,
    "transfer.csv": None,
    "lineage.npz": None,
    "pareto.npz": None,
    "actions.npz": None,
    "sensors.npz": ("selected",),
}


def publish(study: Path, out: Path) -> int:
    """Copy what is published of a study into a new folder, and list it in its SHA256SUMS.

    Returns:
        The size of all that was written, in bytes.

    Raises:
        RunError: if there are no runs below `study`, one cannot be read, a file that would be published is not whole,
            or `out` is there already; then nothing is written.
    """
    found, unreadable = runs.runs_below(study)
    if out.exists():
        raise RunError(f"{out} exists already: choose another folder, or delete it")
    if unreadable:
        raise RunError(f"{unreadable[0]}; or move that run out of the study")
    some: list[AnyRun] = [*found]
    some += [runs.load(config.parent, CellSettings) for config in sorted(study.glob("ablations/*/*/*/*/config.json"))]
    by_folder = {run.folder: run for run in found}
    for run in some:
        # The copy of a cell does not tell what it was equipped from: only what is up to date is copied.
        behind = study / run.task_name / run.settings.evolved if isinstance(run.settings, CellSettings) else None
        provenance.require(run, *_published(run), evolved=by_folder.get(behind) if behind else None)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".publishing-", dir=out.parent) as scratch:
        copy = Path(scratch) / "study"
        size = _write(study, some, copy)
        copy.rename(out)
    return size


def changed_files(published: Path) -> list[str]:
    """Files of a published study that are missing or not what its SHA256SUMS say."""
    lines = (published / CHECKSUMS).read_text().splitlines()
    sums = [line.split("  ", 1) for line in lines]
    return [name for digest, name in sums if files.digest(published / name) != digest]


def _published(run: AnyRun) -> list[str]:
    """Files that are published of a run or a cell, of those that are there."""
    recipes = provenance.OF_CELLS if isinstance(run.settings, CellSettings) else provenance.OF_RUNS
    made = (name for recipe in recipes for name in recipe.makes)
    return [name for name in made if name in CONTENTS and run.file(name).exists()]


def _write(study: Path, some: list[AnyRun], out: Path) -> int:
    """Write what is published of runs and cells, and its checksums; the size of all, in bytes."""
    for run in some:
        _copy_run(run, replace(run, folder=out / run.folder.relative_to(study)))
    # The time of cells is noted for their experiment.
    timed = {run.folder.parents[1] if isinstance(run.settings, CellSettings) else run.folder for run in some}
    for timing in (folder / "timing.csv" for folder in timed):
        if timing.exists():
            shutil.copyfile(timing, out / timing.relative_to(study))
    made = sorted(path for path in out.rglob("*") if path.is_file())
    sums = "".join(f"{files.digest(path)}  {path.relative_to(out).as_posix()}\n" for path in made)
    files.write_text(out / CHECKSUMS, sums)
    return sum(path.stat().st_size for path in [*made, out / CHECKSUMS])


def _copy_run(run: AnyRun, copy: AnyRun) -> None:
    """Copy what is published of a run or a cell; the copy has a record of its own, of what is in it."""
    copy.folder.mkdir(parents=True)
    shutil.copyfile(run.file("config.json"), copy.file("config.json"))
    for name in _published(run):
        _copy(run.file(name), copy.file(name))
        provenance.record(copy, name, files.digest(copy.file(name)))


def _copy(source: Path, target: Path) -> None:
    kept = CONTENTS[source.name]
    if kept is None:
        shutil.copyfile(source, target)
    elif source.suffix == ".csv":
        columns = files.read_csv(source)
        files.write_csv(target, {name: columns[name] for name in kept if name in columns})
    else:
        arrays = files.read_npz(source)
        files.write_npz(target, {name: arrays[name] for name in kept if name in arrays})
