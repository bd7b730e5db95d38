"""Robot tasks: pure functions behind one `Task` interface, and the same as Brax environments."""

from qboot.envs import ball_collecting, box_pushing
from qboot.envs.ball_collecting import BallCollecting
from qboot.envs.box_pushing import BoxPushing
from qboot.envs.types import Task

TASKS = {task.name: task for task in (ball_collecting.TASK, box_pushing.task())}

__all__ = ["TASKS", "BallCollecting", "BoxPushing", "Task"]
