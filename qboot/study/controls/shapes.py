"""What the learners of a control experiment are padded to, so that several share a program.

Padding is computed with: a state of ten inputs in the shape of 156 costs as much as one of 156. But a program takes
seconds to compile. So a learner has the shape of its own size, rounded up, or, where it does so little that this is
cheaper than to compile, the largest of its task, which all can share.
"""

from typing import NamedTuple

from qboot.envs.task import Task
from qboot.extraction.actions import ActionSettings
from qboot.qlearning.learners import LEARNERS
from qboot.qlearning.settings import LearnerSettings
from qboot.study.controls.cells import Cell
from qboot.study.controls.conditions import LAGS
from qboot.study.pipeline.episode import Episode, n_rollouts
from qboot.study.pipeline.profiles import defaults_of
from qboot.study.store.artifacts import read_actions, read_selection, task_of

# Numbers of inputs are rounded up to multiples of this, the decisions of a rollout, which cost memory alone, to powers
# of two from this on.
INPUTS_AT_A_TIME = 16
LEAST_CAPACITY = 64


class Shape(NamedTuple):
    """What cells that learn in one program are padded to."""

    n_actions: int
    n_inputs: int
    capacity: int  # decisions in a rollout at most


def shapes_of(cells: list[Cell]) -> dict[Cell, Shape]:
    """What each cell, equipped, is padded to. Side by side, those of a condition that are next to each other in their
    number of inputs go together; one by one, a shape depends on nothing but the cell.
    """
    own = {cell: shape_of(cell) for cell in cells}
    groups: dict[str, list[Cell]] = {}
    for cell in sorted(cells, key=lambda cell: own[cell].n_inputs):
        groups.setdefault(cell.settings.condition, []).append(cell)
    shapes: dict[Cell, Shape] = {}
    for group in groups.values():
        lanes = group[0].settings.lanes
        for i in range(0, len(group), lanes):
            block = group[i : i + lanes]
            shapes |= dict.fromkeys(block, Shape(*map(max, zip(*(own[cell] for cell in block), strict=True))))
    return shapes


def shape_of(cell: Cell) -> Shape:
    """What a cell, equipped, is padded to where it learns alone."""
    settings, task = cell.settings, task_of(cell)
    durations, n_inputs = read_actions(cell).durations, int(read_selection(cell).sum())
    episode = Episode(
        settings=settings.learner,
        rollouts_per_domain=task.rollouts_per_domain,
        n_rollouts=n_rollouts(task, task.source_domains(settings.source)),
        n_steps=settings.n_steps,
        n_actions=len(durations),
        n_inputs=n_inputs,
        duration=float(durations.mean()),
    )
    shared = largest(task, settings.actions, settings.learner, settings.n_steps)
    if costs_little(task, episode, settings.episodes, shared):
        return shared
    return Shape(len(durations), _rounded(n_inputs), _capacity(settings.n_steps, int(durations.min())))


def largest(task: Task, actions: ActionSettings, learner: LearnerSettings, n_steps: int) -> Shape:
    """The shape that every learner of a task fits into, with these settings, whatever its condition."""
    numbers = [*defaults_of(task).n_actions, actions.n_actions]
    if task.expert:
        numbers.append(len(task.expert.actions().durations))
    n_inputs = max(LAGS, learner.lags) * len(task.sensors)
    return Shape(max(numbers), _rounded(n_inputs), _capacity(n_steps, shortest=1))


def costs_little(task: Task, episode: Episode, n_episodes: int, shape: Shape) -> bool:
    """Whether some episodes in a larger shape cost less above their own cost than to compile a program for them.

    By the task's usual costs, not this machine's: a shape rounds results, which must not depend on machines.
    """
    if LEARNERS[episode.settings.algorithm].replays_room:
        return False
    costs = defaults_of(task).usual_costs
    return n_episodes * (padded(episode, shape).seconds(costs) - episode.seconds(costs)) < costs.compile_learning


def padded(episode: Episode, shape: Shape) -> Episode:
    """An episode in a larger shape."""
    return episode._replace(n_actions=shape.n_actions, n_inputs=shape.n_inputs)


def _rounded(n_inputs: int) -> int:
    return -(-n_inputs // INPUTS_AT_A_TIME) * INPUTS_AT_A_TIME


def _capacity(n_steps: int, shortest: int) -> int:
    decisions = -(-n_steps // shortest)
    return max(LEAST_CAPACITY, 1 << (decisions - 1).bit_length())
