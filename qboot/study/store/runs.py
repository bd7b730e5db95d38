"""A run: its configuration, its folder, and where each of its files lies."""

import dataclasses
import json
import os
import platform
import subprocess
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import qboot
from qboot.envs.registry import get_task
from qboot.study.store import files
from qboot.study.store.files import RunError
from qboot.study.store.settings import CellSettings, RunSettings

# Grows when a file of a run folder changes its meaning.
FORMAT = 1
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

    def require(self, name: str) -> None:
        """Raise RunError unless the run has a file of this name."""
        if not self.file(name).exists():
            raise RunError(f"{self.file(name)} does not exist: run the stage that makes it first")

    @property
    def label(self) -> str:
        """A short name for people."""
        return f"{self.task_name} {self.settings.source}-{self.settings.seed}"

    @property
    def task_name(self) -> str:
        """The short name of the task, also when the settings tell it by where it is defined."""
        return get_task(self.settings.task).name


AnyRun = Run[RunSettings] | Run[CellSettings]


class Found(NamedTuple):
    """What lies below a folder."""

    runs: list[Run[RunSettings]]
    unreadable: list[str]  # why the others cannot be read, a line each


def create(folder: Path, settings: Settings) -> Run[Settings]:
    """The run in `folder`: a new one, or one begun earlier with the same settings.

    Raises:
        RunError: if the folder cannot be written, or holds a run of another version or with other settings.
    """
    config = folder / "config.json"
    if not config.exists():
        files.write_json(config, _describe(settings))
        return Run(folder, settings)
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
            f"{folder} is no run folder (it has no config.json): start one with "
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
    found = files.read_json(config)
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        theirs = found.get("format") if isinstance(found, dict) else None
        raise RunError(
            f"{config} is of format {theirs}, this qboot ({qboot.__version__}) reads format {FORMAT}: "
            "use the qboot that made it, or another --out"
        )
    return found.get("settings", {})


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


def _from_plain(cls: type, values: dict, config: Path) -> Any:
    """A nested dataclass out of plain values."""
    fields = {field.name: field for field in dataclasses.fields(cls)}
    if set(fields) != set(values):
        odd = ", ".join(sorted(set(fields) ^ set(values)))
        raise RunError(f"{config} does not fit this version of qboot (settings {odd}): use another --out")
    built = {}
    for name, value in values.items():
        kind = fields[name].type
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            value = _from_plain(kind, value, config)
        built[name] = tuple(value) if isinstance(value, list) else value
    try:
        return cls(**built)
    except (TypeError, ValueError) as error:
        raise RunError(f"{config} has a setting that cannot be: {error}") from None


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
