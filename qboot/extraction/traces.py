"""Learning traces: the sensori-motor flow of a lineage, recomputed from its genomes (paper, section IV-A)."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from qboot.neuroevolution import evaluation, evolve
from qboot.neuroevolution.behaviour import FLOW
from qboot.neuroevolution.evolve import Problem
from qboot.neuroevolution.lineage import Individuals


class Trace(NamedTuple):
    """The flow of one policy in one test, T steps long."""

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
        One trace per policy and test, cut where the test ended, and the scores (n,) reached.
    """
    found, scores = [], []
    for start in range(0, len(lineage.ids), evaluation.BLOCK):
        some = lineage.take(slice(start, start + evaluation.BLOCK))
        keys = evolve.evaluation_keys(problem, some, some.births)
        function = partial(evaluation.evaluate, problem.task, problem.topology, FLOW, problem.domains)
        flow = evaluation.in_blocks(function, 1, some.genomes, keys)
        observations, commands = flow.descriptions
        for policy, steps in enumerate(flow.steps):
            for test, length in enumerate(steps):
                cut = Trace(observations[policy, test, :length], commands[policy, test, :length])
                found.append(jax.tree.map(np.copy, cut))
        scores.append(flow.scores.sum(axis=1))
        progress(start + len(some.ids))
    return found, np.concatenate(scores)
