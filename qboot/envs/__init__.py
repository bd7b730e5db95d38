"""Robot tasks: pure functions behind one `Task` interface, and the same as Brax environments."""

from typing import TYPE_CHECKING, Any

from qboot.envs.brax_registry import register_when_imported
from qboot.envs.registry import get_task, names, register
from qboot.envs.task import Domain, Expert, Task, TaskState, View

if TYPE_CHECKING:
    from qboot.envs.ball_collecting.environment import BallCollecting
    from qboot.envs.box_pushing.environment import BoxPushing
    from qboot.envs.brax_env import TaskEnv
    from qboot.envs.brax_task import from_brax
    from qboot.envs.gymnasium_env import GymnasiumEnv
    from qboot.envs.sensor_range import estimated_range

# A task's folder knows the rooms that use tasks, and the rest loads Brax or Gymnasium: imported when asked for.
_LATER = {
    "BallCollecting": "qboot.envs.ball_collecting.environment",
    "BoxPushing": "qboot.envs.box_pushing.environment",
    "GymnasiumEnv": "qboot.envs.gymnasium_env",
    "TaskEnv": "qboot.envs.brax_env",
    "estimated_range": "qboot.envs.sensor_range",
    "from_brax": "qboot.envs.brax_task",
}

register_when_imported()

__all__ = [
    "BallCollecting",
    "BoxPushing",
    "Domain",
    "Expert",
    "GymnasiumEnv",
    "Task",
    "TaskEnv",
    "TaskState",
    "View",
    "estimated_range",
    "from_brax",
    "get_task",
    "names",
    "register",
]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        import importlib

        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
