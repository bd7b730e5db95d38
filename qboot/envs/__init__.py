"""Robot tasks: pure functions behind one `Task` interface, and the same as Brax environments."""

from typing import TYPE_CHECKING, Any

from qboot.envs.registry import get_task, names, register
from qboot.envs.task import Domain, Expert, Task, TaskState, View

if TYPE_CHECKING:
    from qboot.envs.ball_collecting import BallCollecting
    from qboot.envs.box_pushing import BoxPushing

# A task's folder knows the rooms that use tasks, so it is imported when it is asked for.
_LATER = {"BallCollecting": "qboot.envs.ball_collecting", "BoxPushing": "qboot.envs.box_pushing"}

__all__ = [
    "BallCollecting",
    "BoxPushing",
    "Domain",
    "Expert",
    "Task",
    "TaskState",
    "View",
    "get_task",
    "names",
    "register",
]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        import importlib

        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
