"""Robot tasks: pure functions behind one `Task` interface, and the same as Brax environments."""

from qboot.envs.ball_collecting import dynamics as ball_collecting
from qboot.envs.ball_collecting.dynamics import BallCollecting
from qboot.envs.box_pushing import dynamics as box_pushing
from qboot.envs.box_pushing.dynamics import BoxPushing
from qboot.envs.task import Task

TASKS = {task.name: task for task in (ball_collecting.TASK, box_pushing.task())}
# The physics that a task can run on, the one of record first.
PHYSICS = {"ball_collecting": ("fastsim",), "box_pushing": tuple(box_pushing.PHYSICS)}


def make_task(name: str, physics: str) -> Task:
    """A task on one of its physics.

    Raises:
        ValueError: for an unknown task, or a physics that the task does not have.
    """
    if name not in TASKS:
        raise ValueError(f"unknown task {name!r}: choose one of {', '.join(TASKS)}")
    if physics not in PHYSICS[name]:
        raise ValueError(f"unknown physics {physics!r} of {name}: choose one of {', '.join(PHYSICS[name])}")
    return box_pushing.task(physics) if name == "box_pushing" else TASKS[name]


__all__ = ["PHYSICS", "TASKS", "BallCollecting", "BoxPushing", "Task", "make_task"]
