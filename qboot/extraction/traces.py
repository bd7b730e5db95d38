"""Learning traces: the sensori-motor flow of a lineage, recomputed from its genomes (paper, section IV-A)."""

from collections.abc import Callable
from typing import NamedTuple

import chex
import jax
import numpy as np

from qboot.neuroevolution.dnn import least_room
from qboot.neuroevolution.evaluation import BLOCK
from qboot.neuroevolution.lineage import Individuals
from qboot.neuroevolution.problem import Problem, evaluate_individuals
from qboot.neuroevolution.recorders import FLOW


class Trace(NamedTuple):
    """The flow of one policy in one rollout, T steps long: O and U of section IV-A."""

    observations: np.ndarray  # (T, S)
    commands: np.ndarray  # (T, E), each in response to the observation of the same step


def traces(
    problem: Problem, lineage: Individuals, progress: Callable[[int], None] = lambda done: None
) -> tuple[list[Trace], np.ndarray]:
    """Run every policy of a lineage again, from the starts that it was evaluated with at its birth.

    Args:
        problem: of the evolutionary run.
        lineage: n policies.
        progress: called with the number of policies done.

    Returns:
        One trace per policy and rollout, cut where it ended, and the scores (n,) reached.

    Raises:
        AssertionError: if leading axes of the lineage differ.
    """
    chex.assert_rank(lineage.ids, 1)
    chex.assert_tree_shape_prefix(lineage, lineage.ids.shape)
    found, scores = [], []
    room = least_room(lineage.genomes, problem.dnn)  # one compiled program for all
    for start in range(0, len(lineage.ids), BLOCK):
        some = lineage.take(slice(start, start + BLOCK))
        flow = evaluate_individuals(problem, FLOW, some, some.births, room)
        observations, commands = flow.descriptors
        for policy, steps in enumerate(flow.steps):
            for rollout, length in enumerate(steps):
                cut = Trace(observations[policy, rollout, :length], commands[policy, rollout, :length])
                found.append(jax.tree.map(np.copy, cut))
        scores.append(flow.scores.sum(axis=1))
        progress(start + len(some.ids))
    return found, np.concatenate(scores)
