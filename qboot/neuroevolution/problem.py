"""What is evolved: the problem that every algorithm gets, how individuals are evaluated in it, and what is logged."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from qboot.envs.task import Domain, Task
from qboot.keys import keys
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.evaluation import Evaluation
from qboot.neuroevolution.lineage import Individuals
from qboot.neuroevolution.recorders import Recorder

if TYPE_CHECKING:  # the settings choose an algorithm, and algorithms get problems
    from qboot.neuroevolution.settings import EvolutionSettings


@dataclass(frozen=True, eq=False)
class Problem:
    """What is evolved, where and from which seed: all that stays the same in a run.

    Raises:
        ValueError: if the networks do not have an input for each sensor and an output for each effector of the task.
    """

    task: Task
    domains: Domain
    settings: "EvolutionSettings"
    dnn: DnnSettings
    key: jax.Array
    workers: int  # threads; does not change results

    def __post_init__(self):
        """Reject networks that do not fit the task."""
        check_dnn(self.task, self.dnn)


def check_dnn(task: Task, dnn: DnnSettings) -> None:
    """Refuse networks without an input for each sensor and an output for each effector of the task.

    Raises:
        ValueError: if a number differs.
    """
    for name, given, parts, needed in (
        ("n_inputs", dnn.n_inputs, "sensors", len(task.sensors)),
        ("n_outputs", dnn.n_outputs, "effectors", len(task.effectors)),
    ):
        if given != needed:
            raise ValueError(f"{name} is {given}, but {task.name} has {needed} {parts}: it must be {needed}")


class EvolveInfo(NamedTuple):
    """What is logged of a generation."""

    generation: int
    episodes: int  # evaluations so far
    best: float
    median: float
    mean: float
    diversity: str  # distance in force, empty where an algorithm has none
    lived: float  # share of max_steps that those evaluated lived on average
    connections: float  # mean of the population
    hidden: float  # mean of the population
    refused: int  # mutations refused for want of room


def evaluate_individuals(
    problem: Problem,
    recorder: Recorder,
    individuals: Individuals,
    generation: int | np.ndarray,
    room: int | None = None,
    block: int | None = None,
) -> Evaluation:
    """Evaluate B individuals, one episode each, from the starts that `generation`, or each one's (B,), gives them.

    Doing so again, in the same `room` for hidden neurons, gives the same to the bit; None is the least room that they
    fit into. `block` is that of `evaluate_all`. Returns NumPy arrays.
    """
    keys = evaluation_keys(problem, individuals, generation)
    return evaluation.evaluate_all(
        problem.task, problem.dnn, recorder, problem.domains, individuals.genomes, keys, problem.workers, room, block
    )


def evaluation_keys(problem: Problem, individuals: Individuals, generation: int | np.ndarray) -> jax.Array:
    """The random keys (B,) that individuals are evaluated with in `generation`, or (B,) in the generation of each.

    Starts depend on the individual alone, or, when all are evaluated again, on the generation alone.
    """
    numbers = generation if problem.settings.reevaluate else individuals.ids
    return keys(problem.key, "evaluation", np.broadcast_to(numbers, individuals.ids.shape))
