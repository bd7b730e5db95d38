"""Learning traces: the sensori-motor flow of a lineage, recomputed from its genomes (paper, section IV-A)."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import chex
import jax
import numpy as np

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
    """Run every policy of a lineage again, from the starts and in the room that it was evaluated with at its birth.

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
    found: dict[int, list[Trace]] = {}
    scores = np.zeros(len(lineage.ids), np.float32)
    size = min(BLOCK, problem.settings.population)
    for room, block in _blocks(lineage.rooms, size):
        some = lineage.take(block)
        flow = evaluate_individuals(problem, FLOW, some, some.births, room, size)
        observations, commands = flow.descriptors
        for row, policy in enumerate(block):
            found[policy] = [
                jax.tree.map(np.copy, Trace(observations[row, rollout, :length], commands[row, rollout, :length]))
                for rollout, length in enumerate(flow.steps[row])
            ]
        scores[block] = flow.scores.sum(axis=1)
        progress(len(found))
    return [trace for policy in sorted(found) for trace in found[policy]], scores


def _blocks(rooms: np.ndarray, size: int) -> Iterator[tuple[int, np.ndarray]]:
    """Policies of one room, `size` at most at a time, of `rooms` (n,)."""
    for room in np.unique(rooms):
        policies = np.flatnonzero(rooms == room)
        for start in range(0, len(policies), size):
            yield int(room), policies[start : start + size]
