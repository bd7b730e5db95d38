"""Which tasks there are, and how one is found: by a registered name, or by where it is defined."""

import importlib
import importlib.util
import sys
import warnings
from importlib import metadata
from pathlib import Path
from types import ModuleType

from qboot.envs.task import Task

# Installed packages bring tasks by entry points of this group: NAME = "package.module:TASK".
ENTRY_POINTS = "qboot.tasks"
# The tasks of the paper; imported when they are asked for.
BUILT_IN = {
    "ball_collecting": "qboot.envs.ball_collecting:TASK",
    "box_pushing": "qboot.envs.box_pushing:TASK",
}
_registered: dict[str, Task] = {}


def register(task: Task) -> Task:
    """Make a task known by its name, in this process; returns it.

    Raises:
        ValueError: if the name is taken by another task, or cannot be the name of a folder.
    """
    if not task.name or not task.name.replace("_", "").replace("-", "").isalnum():
        raise ValueError(f"task name {task.name!r}: use letters, digits, '_' and '-', it names a folder of the study")
    known = _registered.get(task.name)
    if task.name in BUILT_IN or (known is not None and known != task):
        raise ValueError(f"there is a task {task.name!r} already: choose another name")
    _registered[task.name] = task
    return task


def names() -> list[str]:
    """Names of all tasks known: built in, registered in this process, brought by installed packages."""
    return list(dict.fromkeys([*BUILT_IN, *_registered, *_entry_points()]))


def get_task(name: str, physics: str | None = None) -> Task:
    """A task by its name, as `package.module:TASK` or as `path/to/file.py:TASK`.

    Args:
        name: what to look for.
        physics: one of the task's `physics`; None for the one of record.

    Raises:
        ValueError: if there is no such task, or it does not have the physics.
    """
    task = _found(name)
    if physics is None or physics == task.physics[0]:
        return task
    if physics not in task.physics or task.on_physics is None:
        raise ValueError(f"unknown physics {physics!r} of {task.name}: choose one of {', '.join(task.physics)}")
    return task.on_physics(physics)


def canonical(name: str) -> str:
    """`name` so that it means the same from any folder: the path of a file is made absolute."""
    place, colon, attribute = name.rpartition(":")
    return f"{Path(place).resolve()}:{attribute}" if colon and place.endswith(".py") else name


def _found(name: str) -> Task:
    if name in _registered:
        return _registered[name]
    # Every file of a study asks for its task; to look through the installed packages takes milliseconds.
    where = BUILT_IN.get(name) or (name if ":" in name else _entry_points().get(name, name))
    place, colon, attribute = where.rpartition(":")
    if not colon:
        raise ValueError(
            f"unknown task {name!r}: choose one of {', '.join(names())}, or say package.module:TASK or "
            "path/to/file.py:TASK"
        )
    task = getattr(_module(name, place), attribute, None)
    if not isinstance(task, Task):
        raise ValueError(f"{name}: {place} has no qboot Task named {attribute!r}")
    return task


def _module(name: str, place: str) -> ModuleType:
    """The module that a task is defined in; a file is loaded once."""
    try:
        if not place.endswith(".py"):
            return importlib.import_module(place)
        path = Path(place).resolve()
        if not path.is_file():
            raise ValueError(f"{name}: there is no file {place}")
        module_name = f"qboot_task_{path.stem}_{abs(hash(str(path))):x}"
        if module_name not in sys.modules:
            spec = importlib.util.spec_from_file_location(module_name, path)
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            sys.modules[module_name] = module
            try:
                with warnings.catch_warnings():
                    # Brax says so at every start of every command.
                    warnings.filterwarnings("ignore", message="Brax System, .* not actively being maintained")
                    spec.loader.exec_module(module)
            except BaseException:
                del sys.modules[module_name]
                raise
        return sys.modules[module_name]
    except (ImportError, SyntaxError) as error:
        raise ValueError(f"{name}: cannot import {place}: {error}") from None


def _entry_points() -> dict[str, str]:
    """Where the tasks of installed packages are, by name."""
    return {point.name: point.value for point in metadata.entry_points(group=ENTRY_POINTS)}
