"""Where each file of a run comes from: which settings and which other files it was made with, and whether it is whole.

A run folder keeps a record, `files.json`: for every file its digest, and the identity of what it was made with. A file
that is not as recorded, or was made with other settings or from other files than those of now, is not believed. The
record is written just before its file appears, so a kill in between leaves a file that is missing, never one that
nobody knows. Changing a setting touches only the files that depend on it.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from qboot.envs.registry import get_task
from qboot.study.store import files
from qboot.study.store.files import RunError
from qboot.study.store.recipes import EVOLVED, OF_CELLS, OF_RUNS, Recipe
from qboot.study.store.runs import FORMAT, AnyRun
from qboot.study.store.settings import CellSettings

RECORD = "files.json"


def recipe_of(run: AnyRun, name: str) -> Recipe:
    """The recipe of a file of a run or a cell."""
    recipes = OF_CELLS if isinstance(run.settings, CellSettings) else OF_RUNS
    return next(recipe for recipe in recipes if name in recipe.makes)


def identity(run: AnyRun, recipe: Recipe) -> str:
    """Of what a step of a run makes: a digest of the settings and of the files that it depends on."""
    return _identity(run, recipe, _recorded(run))


def fault(run: AnyRun, name: str, evolved: AnyRun | None = None) -> str:
    """What is wrong with a file of a run, as the end of a sentence; empty if it is whole and made as it should be.

    With its `evolved` run, a cell is judged by what that run's files are now, not by what they were when the cell was
    equipped. A published cell does not tell what it was equipped from, and is taken as it is.
    """
    path, entries = run.file(name), _recorded(run)
    if evolved:
        entries |= {each: now for each, now in _of_evolved(evolved).items() if each in entries}
    if not path.exists():
        return "does not exist"
    if name not in entries:
        return f"is not a file that this run made ({RECORD} does not tell of it)"
    if files.digest(path) != entries[name]["sha256"]:
        return "is damaged, or was changed"
    if entries[name]["identity"] != _identity(run, recipe_of(run, name), entries):
        return "was made with other settings, or from other files than those of now"
    return ""


def is_whole(run: AnyRun, name: str, evolved: AnyRun | None = None) -> bool:
    """Whether a file of a run is there, whole, and made as it should be."""
    return not fault(run, name, evolved)


def require(run: AnyRun, *names: str, evolved: AnyRun | None = None) -> None:
    """Raise RunError, which says what to do, unless the files of a run are whole and made as they should be."""
    for name in names:
        if wrong := fault(run, name, evolved):
            raise RunError(f"{run.file(name)} {wrong}{_loss(run, name)}: {_advice(run, name)}")


def record(run: AnyRun, name: str, digest: str) -> None:
    """Note in the record that a file is about to appear, made with the settings and from the files of now."""
    entries = _recorded(run)
    entry = {"sha256": digest, "identity": _identity(run, recipe_of(run, name), entries)}
    _write(run, entries | {name: entry})


def record_evolved(cell: AnyRun, evolved: AnyRun) -> None:
    """Note in a cell's record what its evolved run's files are now."""
    theirs, known = _of_evolved(evolved), _recorded(cell)
    entries = {name: theirs.get(name, {"sha256": "", "identity": ""}) for name in EVOLVED}
    if known != known | entries:
        _write(cell, known | entries)


def set_aside_faulty(run: AnyRun, recipe: Recipe) -> None:
    """Set aside what lies where a step is to put its files, if it is not to be believed."""
    if run.file(RECORD).exists() and _read(run) is None:
        files.set_aside(run.file(RECORD), "is damaged")
    for name in recipe.makes:
        if run.file(name).exists() and (wrong := fault(run, name)):
            files.set_aside(run.file(name), wrong)


def _identity(run: AnyRun, recipe: Recipe, entries: Mapping[str, Mapping[str, str]]) -> str:
    settings: Any = run.settings
    values = {name: getattr(settings, name) for name in recipe.settings}
    plain = {name: dataclasses.asdict(v) if dataclasses.is_dataclass(v) else v for name, v in values.items()}  # type: ignore[arg-type]
    made_from = {name: entries.get(name, {}).get("sha256") for name in recipe.needs}
    whole = [FORMAT, recipe.step, get_task(settings.task).name, plain, made_from]
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def _of_evolved(evolved: AnyRun) -> dict[str, dict[str, str]]:
    """What an evolved run's record tells now, as a cell's record repeats it."""
    theirs = _recorded(evolved)
    return {name: theirs[own] for name in EVOLVED if (own := name.removeprefix("evolved/")) in theirs}


def _recorded(run: AnyRun) -> dict[str, dict[str, str]]:
    """The record; empty where there is none that can be read: then no file is believed."""
    return _read(run) or {}


def _read(run: AnyRun) -> dict[str, dict[str, str]] | None:
    try:
        found = files.read_json(run.file(RECORD))
    except RunError:
        return None
    is_record = isinstance(found, dict) and all(
        isinstance(entry, dict) and set(entry) == {"sha256", "identity"} for entry in found.values()
    )
    return found if is_record else None


def _write(run: AnyRun, entries: Mapping[str, Mapping[str, str]]) -> None:
    # In order of names: the record of a run does not depend on how it was interrupted.
    files.write_json(run.file(RECORD), dict(sorted(entries.items())))


def _loss(run: AnyRun, name: str) -> str:
    """Why a learner's file may be missing for good."""
    lost = run.file(diverged_name(name))
    return f", for the learner diverged ({lost.name} has its history)" if lost.exists() else ""


def diverged_name(name: str) -> str:
    """Name of the history of a learner that diverged, whose history else would be called `name`."""
    stem = {"qnets.npz": "qlearning", "transfer.csv": "target_learn"}.get(name, name.partition(".")[0])
    return f"{stem}.diverged.csv"


def _advice(run: AnyRun, name: str) -> str:
    recipe = recipe_of(run, name)
    if not isinstance(run.settings, CellSettings):
        return f"run `qboot {recipe.step} --out {run.folder}`, which makes it anew"
    settings = run.settings
    study = run.folder.parents[4]
    return (
        f"run `qboot ablate --task {settings.task} --what {settings.what} --profile {settings.profile} "
        f"--episodes {settings.episodes} --lanes {settings.lanes} --out {study}`, which makes it anew"
    )
