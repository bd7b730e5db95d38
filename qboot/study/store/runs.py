"""A run: its configuration, its folder, and where each of its files lies."""

import contextlib
import dataclasses
import json
import math
import os
import platform
import subprocess
import types
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import qboot
from qboot.envs.registry import get_task
from qboot.study.store import files, lock
from qboot.study.store.files import RunError
from qboot.study.store.settings import CellSettings, RunSettings

# Grows when a file of a run folder changes its meaning.
FORMAT = 2
PACKAGES = ("jax", "jaxlib", "numpy", "scipy", "scikit-learn", "brax", "mujoco", "mujoco-mjx", "rapidfuzz")


Settings = TypeVar("Settings", RunSettings, CellSettings)


@dataclass(frozen=True)
class Run(Generic[Settings]):
    """A folder and the settings that all in it was made with: of a run, or of a learner of a control experiment."""

    folder: Path
    settings: Settings

    def file(self, name: str) -> Path:
        """Path of a file of the run."""
        return self.folder / name

    @property
    def label(self) -> str:
        """A short name for people."""
        return f"{self.task_name} {self.settings.source}-{self.settings.seed}"

    @property
    def task_name(self) -> str:
        """The short name of the task, also when the settings tell it by where it is defined."""
        return get_task(self.settings.task).name


AnyRun = Run[RunSettings] | Run[CellSettings]


class Damaged(RunError):
    """A config.json that cannot be read."""


class Found(NamedTuple):
    """What lies below a folder."""

    runs: list[Run[RunSettings]]
    unreadable: list[str]  # why the others cannot be read, a line each


def create(folder: Path, settings: Settings) -> Run[Settings]:
    """The run in `folder`: a new one, or one begun earlier with the same settings.

    Raises:
        RunError: if the folder cannot be written, is in use, or holds a run of another version or with other settings.
    """
    config = folder / "config.json"
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    if not config.exists():
        try:
            with lock.owned(folder):
                if not config.exists():
                    files.write_json(config, _describe(settings))
        except RunError:
            for path in new:  # a run that cannot be begun leaves nothing
                with contextlib.suppress(OSError):
                    path.rmdir()
            raise
    found = _read(config)
    wanted = _plain(settings)
    for name in wanted:
        if found.get(name) != wanted[name]:
            raise RunError(
                f"{folder} holds a run with {_difference(name, found.get(name), wanted[name])}: "
                "choose another --out, or delete that folder"
            )
    return Run(folder, settings)


def load(folder: Path, kind: type[Settings] = RunSettings) -> Run[Settings]:  # type: ignore[assignment]
    """The run in `folder`, whose settings are of a `kind` of dataclass.

    Raises:
        RunError: if there is none, or one of another version.
    """
    config = folder / "config.json"
    if not config.exists():
        raise RunError(
            f"{folder} is no run folder (it has no config.json): begin a run there with "
            f"`qboot evolve --task TASK --out {folder}`"
        )
    return Run(folder, _from_plain(kind, _read(config), config))


def folder_of(study: Path, settings: RunSettings) -> Path:
    """Where a run is in the folder of a study: TASK/SOURCE-SEED."""
    return study / get_task(settings.task).name / f"{settings.source}-{settings.seed}"


def find(results: Path) -> list[Run[RunSettings]]:
    """All runs below a folder, in order of their paths."""
    return [load(config.parent) for config in sorted(results.glob("*/*/config.json"))]


def _read(config: Path) -> dict:
    try:
        found = files.read_json(config)
    except RunError as error:
        words = str(error).partition(": delete it")[0]
        raise Damaged(
            f"{words}: delete it and begin the run again with its --task, --source, --seed, --profile and other "
            "settings; what was made with the same ones is used"
        ) from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        theirs = found.get("format") if isinstance(found, dict) else None
        raise RunError(
            f"{config} is of format {theirs}, this qboot ({qboot.__version__}) reads format {FORMAT}: "
            "use the qboot that made it, or another --out"
        )
    settings = found.get("settings")
    return settings if isinstance(settings, dict) else {}


def _describe(settings: RunSettings | CellSettings) -> dict:
    return {
        "format": FORMAT,
        "qboot": qboot.__version__,
        "git_commit": _git_commit(),
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in PACKAGES},
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
        "settings": _plain(settings),
    }


def _git_commit() -> str:
    """The commit of the code, with a plus when it was changed since; empty outside a checkout."""
    here = Path(__file__).parent
    try:
        commit = subprocess.run(
            ["git", "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"],
            cwd=here, capture_output=True, text=True, check=True,
        )  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return ""
    return commit.stdout.strip()


def _plain(settings: RunSettings | CellSettings) -> dict:
    """Settings as JSON gives them back."""
    return json.loads(json.dumps(dataclasses.asdict(settings)))


def _from_plain(cls: type, values: Any, config: Path) -> Any:
    """A nested dataclass out of plain values."""
    fields = get_type_hints(cls)
    if not isinstance(values, dict) or set(fields) != set(values):
        odd = ", ".join(sorted(set(fields) ^ set(values))) if isinstance(values, dict) else f"of {cls.__name__}"
        raise RunError(f"{config} does not fit this version of qboot (settings {odd}): use another --out")
    built = {}
    for name, value in values.items():
        kind = fields[name]
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            built[name] = _from_plain(kind, value, config)
        else:
            built[name] = tuple(value) if isinstance(value, list) else value
            if not _is_of(kind, built[name]):
                raise RunError(f"{config} has a setting that cannot be: {name} is {value!r}, not of {_in_words(kind)}")
    try:
        return cls(**built)
    except (TypeError, ValueError) as error:
        raise RunError(f"{config} has a setting that cannot be: {error}") from None


def _is_of(kind: Any, value: Any) -> bool:
    """Whether a plain value is of an annotated kind: a number, a flag, a text, or a tuple of such."""
    if get_origin(kind) in (types.UnionType, Union):
        return any(_is_of(each, value) for each in get_args(kind))
    if get_origin(kind) is tuple:
        kinds = get_args(kind)
        if not isinstance(value, tuple):
            return False
        if kinds[-1] is Ellipsis:
            return all(_is_of(kinds[0], each) for each in value)
        return len(kinds) == len(value) and all(map(_is_of, kinds, value))
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return type(value) is kind


def _in_words(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) else str(kind)


def _difference(name: str, found: Any, wanted: Any) -> str:
    """The first setting in which two plain settings differ, in words."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in wanted:
            if found.get(key) != wanted[key]:
                return _difference(f"{name}.{key}", found.get(key), wanted[key])
    return f"{name} = {found}, not {wanted}"


def runs_below(folder: Path) -> Found:
    """All runs of a study, or the one run that `folder` is; those that cannot be read are told apart.

    Raises:
        RunError: if there is none that can be read.
    """
    configs = [folder / "config.json"] if (folder / "config.json").exists() else sorted(folder.glob("*/*/config.json"))
    found = Found([], [])
    for config in configs:
        try:
            run = load(config.parent)
            get_task(run.settings.task, run.settings.physics)
        except (RunError, ValueError) as error:
            words = str(error)
            found.unreadable.append(words if str(config) in words else f"{config}: {words}")
        else:
            found.runs.append(run)
    if not configs:
        raise RunError(
            f"no runs below {folder}: give the folder of a study (FOLDER/TASK/SOURCE-SEED/config.json) or of a run"
        )
    if not found.runs:
        raise RunError(f"no run below {folder} can be read: {found.unreadable[0]}")
    return found
