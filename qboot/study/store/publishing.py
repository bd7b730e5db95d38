"""What is published of a study: the small files behind its numbers and its figures of scores, with checksums.

Networks are left out, and columns that no figure needs; `qboot report` and `experiments/results.py` read the copy as
they read a study. Figures that replay networks say that they are missing.
"""

import hashlib
import shutil
from collections.abc import Mapping
from pathlib import Path

from qboot.study.store import files, runs

CHECKSUMS = "SHA256SUMS"
_LEARNING = ("episode", "score", "steps")
# Columns or arrays that are kept; None for the whole file. A run or a cell may lack some of the files.
CONTENTS: Mapping[str, tuple[str, ...] | None] = {
    "config.json": None,
    "timing.csv": None,
    "history.csv": ("generation", "episodes", "best"),
    "qlearning.csv": _LEARNING,
    "generalisation.csv": None,
    "transfer.csv": None,
    "lineage.npz": ("ids", "parents", "births", "scores"),
    "actions.npz": None,
    "sensors.npz": ("selected",),
}


def publish(study: Path, out: Path) -> int:
    """Copy what is published of a study into a new folder, and list it in its SHA256SUMS.

    Returns:
        The size of all that was written, in bytes.

    Raises:
        RunError: if there are no runs below `study`, a file is damaged, or `out` is there already.
    """
    runs.runs_below(study)
    if out.exists():
        raise files.RunError(f"{out} exists already: choose another folder, or delete it")
    for source in sorted([*study.glob("*/*/*"), *study.glob("ablations/*/*/*"), *study.glob("ablations/*/*/*/*/*")]):
        if source.name in CONTENTS and source.is_file():
            _copy(source, out / source.relative_to(study))
    made = sorted(path for path in out.rglob("*") if path.is_file())
    sums = "".join(f"{_digest(path)}  {path.relative_to(out).as_posix()}\n" for path in made)
    files.write_text(out / CHECKSUMS, sums)
    return sum(path.stat().st_size for path in [*made, out / CHECKSUMS])


def changed_files(published: Path) -> list[str]:
    """Files of a published study that are missing or not what its SHA256SUMS say."""
    lines = (published / CHECKSUMS).read_text().splitlines()
    listed = dict(reversed(line.split("  ", 1)) for line in lines)
    there = {name: published / name for name in listed}
    return [name for name, path in there.items() if not path.exists() or _digest(path) != listed[name]]


def _copy(source: Path, target: Path) -> None:
    kept = CONTENTS[source.name]
    if kept is None:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    elif source.suffix == ".csv":
        columns = files.read_csv(source)
        files.write_csv(target, {name: columns[name] for name in kept if name in columns})
    else:
        arrays = files.read_npz(source)
        files.write_npz(target, {name: arrays[name] for name in kept if name in arrays})


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
