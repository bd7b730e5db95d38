"""A run: its configuration, its folder, and where each of its files lies."""

import dataclasses
import json
import os
import platform
import subprocess
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import qboot
from qboot.extraction.actions import ActionSettings
from qboot.extraction.sensors import SensorSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.qlearning.settings import LearnerSettings
from qboot.study import files
from qboot.study.files import RunError

# Grows when a file of a run folder changes its meaning.
FORMAT = 1
PACKAGES = ("jax", "jaxlib", "numpy", "scipy", "scikit-learn", "brax", "mujoco", "mujoco-mjx", "rapidfuzz")


@dataclass(frozen=True)
class RunSettings:
    """Every setting of a run; the defaults of a task and a profile come from `qboot.study.profiles`."""

    task: str
    """ball_collecting or box_pushing."""
    source: str
    """Source domain set: A, B or C for ball collecting."""
    physics: str
    """fastsim for ball collecting; mjx, the physics of record, or its twin kinematic for box pushing."""
    seed: int
    """Everything random comes from it."""
    profile: str
    """Name of the profile that the sizes come from."""
    n_steps: int
    """Steps of one test at most."""
    dnn: DnnSettings
    evolution: EvolutionSettings
    actions: ActionSettings
    sensors: SensorSettings
    learner: LearnerSettings
    episodes: int
    """Q-learning episodes on the source set."""
    target_episodes: int
    """Q-learning episodes on the target set."""
    target_generations: int
    """Generations of ER and of ER + transfer on the target set."""

    def __post_init__(self):
        """Reject sizes that make no run."""
        for name in ("seed", "episodes", "target_episodes", "target_generations"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is {getattr(self, name)}: it must not be negative")
        if self.n_steps < 1:
            raise ValueError(f"n_steps is {self.n_steps}: a test has at least 1 step")


@dataclass(frozen=True)
class Run:
    """A run folder and its settings."""

    folder: Path
    settings: RunSettings

    def file(self, name: str) -> Path:
        """Path of a file of the run."""
        return self.folder / name

    @property
    def label(self) -> str:
        """A short name for people."""
        return f"{self.settings.task} {self.settings.source}-{self.settings.seed}"


def create(folder: Path, settings: RunSettings) -> Run:
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


def load(folder: Path, kind: type = RunSettings) -> Run:
    """The run in `folder`, whose settings are of a `kind` of dataclass.

    Raises:
        RunError: if there is none, or one of another version.
    """
    config = folder / "config.json"
    if not config.exists():
        raise RunError(
            f"{folder} is no run folder (it has no config.json): start one with `qboot evolve --out {folder}`"
        )
    return Run(folder, _from_plain(kind, _read(config), config))


def find(results: Path) -> list[Run]:
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


def _describe(settings: RunSettings) -> dict:
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


def _plain(settings: RunSettings) -> dict:
    """Settings as JSON gives them back."""
    return json.loads(json.dumps(dataclasses.asdict(settings)))


def _from_plain(cls: type, values: dict, config: Path):
    """A nested dataclass out of plain values."""
    fields = {field.name: field for field in dataclasses.fields(cls)}
    if set(fields) != set(values):
        odd = ", ".join(sorted(set(fields) ^ set(values)))
        raise RunError(f"{config} does not fit this version of qboot (settings {odd}): use another --out")
    built = {}
    for name, value in values.items():
        kind = fields[name].type
        if dataclasses.is_dataclass(kind):
            value = _from_plain(kind, value, config)
        built[name] = tuple(value) if isinstance(value, list) else value
    try:
        return cls(**built)
    except (TypeError, ValueError) as error:
        raise RunError(f"{config} has a setting that cannot be: {error}") from None


def _difference(name: str, found, wanted) -> str:
    """The first setting in which two plain settings differ, in words."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in wanted:
            if found.get(key) != wanted[key]:
                return _difference(f"{name}.{key}", found.get(key), wanted[key])
    return f"{name} = {found}, not {wanted}"
