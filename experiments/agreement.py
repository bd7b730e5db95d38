"""Do policies of box pushing score the same in both physics?

    python experiments/agreement.py [RUN ...] [--random N] [--seeds N]

Tested on MuJoCo (mjx) and on its closed-form twin (kinematic), from the same random starts on the source blocks: the
networks of the lineages of finished runs and the greedy policies that those runs have learned, random networks of the
first generation, and greedy policies of random Q-networks. Prints one JSON object per kind of policy:

    policies, rollouts        how many
    different                 rollouts that end otherwise: pushed, touched otherwise, or not touched; of Q-networks,
                              scores in one domain (of 5) that are not equal
    outcome_agreement         share of those that do not differ
    largest_score_difference  between the two scores (of 15) that a policy has
    score_mjx, score_kinematic  means over the policies
"""

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qboot import qlearning
from qboot.envs.box_pushing import PHYSICS, on_physics
from qboot.extraction.actions import ActionSet
from qboot.extraction.baselines import chosen_sensors
from qboot.neuroevolution import dnn, evaluation
from qboot.neuroevolution.dnn import DnnSettings, Genome
from qboot.neuroevolution.recorders import FLOW
from qboot.study.pipeline.learning import problem_on
from qboot.study.pipeline.profiles import defaults_of
from qboot.study.store import runs
from qboot.study.store.artifacts import read_lineage, read_networks
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run


def rollouts(physics: str, genomes: Genome, settings: DnnSettings, seed: int) -> evaluation.Evaluation:
    """One episode of B networks on the source blocks; the same `seed` gives the same starts on any physics."""
    keys = jax.random.split(jax.random.key(seed), len(genomes.weights))
    robot = on_physics(physics)
    found = evaluation.evaluate_all(robot, settings, FLOW, robot.source_domains("A"), genomes, keys, workers=1)
    return found._replace(descriptors=None)


def agreement(genomes: Genome, settings: DnnSettings, seed: int = 0) -> dict[str, float]:
    """The figures that this script prints, for B networks."""
    mjx, kinematic = (rollouts(physics, genomes, settings, seed) for physics in PHYSICS)
    longest = on_physics("mjx").max_steps

    def ends(result: evaluation.Evaluation) -> np.ndarray:
        """0 not touched, 1 touched, 2 pushed; a touch in the very last step counts as not touched."""
        return np.where(result.scores > 0, 2, result.steps < longest)

    return figures(ends(mjx) != ends(kinematic), np.asarray(mjx.scores), np.asarray(kinematic.scores))


def agreement_of_policies(networks: Any, problem: qlearning.Problem, seed: int = 0) -> dict[str, float]:
    """The same figures for the greedy policies of B Q-networks (leading axis), by their scores in each domain."""
    n = len(jax.tree.leaves(networks)[0])
    keys = jax.random.split(jax.random.key(seed), n)

    def scores(physics: str) -> np.ndarray:
        there = qlearning.Problem(
            on_physics(physics), problem.settings, problem.domains, problem.actions, problem.inputs
        )
        return np.asarray(jax.jit(jax.vmap(partial(qlearning.evaluate, problem=there)))(networks, keys))

    mjx, kinematic = (scores(physics) for physics in PHYSICS)
    found = figures(mjx != kinematic, mjx, kinematic)
    return found | {"rollouts": mjx.size * problem.task.rollouts_per_domain}


def figures(different: np.ndarray, mjx: np.ndarray, kinematic: np.ndarray) -> dict[str, float]:
    """What is printed, from what differs and the scores (B, ...) in both physics."""
    totals = [scores.reshape(len(scores), -1).sum(axis=1) for scores in (mjx, kinematic)]
    return {
        "policies": len(mjx),
        "rollouts": mjx.size,
        "different": int(different.sum()),
        "outcome_agreement": float(1.0 - different.mean()),
        "largest_score_difference": float(np.abs(totals[0] - totals[1]).max()),
        "score_mjx": float(totals[0].mean()),
        "score_kinematic": float(totals[1].mean()),
    }


def lineages(some: list[Run]) -> tuple[Genome, DnnSettings]:
    """All networks of the lineages of runs, which must share their settings.

    Raises:
        RunError: if a folder is no run of box pushing that has evolved, or the topologies differ.
    """
    for run in some:
        if run.settings.task != "box_pushing":
            raise RunError(f"{run.folder} is a run of {run.settings.task}: give runs of box_pushing")
        if run.settings.dnn != some[0].settings.dnn:
            raise RunError(f"{run.folder} has networks with other settings than {some[0].folder}: compare them apart")
    genomes = [read_lineage(run).genomes for run in some]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *genomes), some[0].settings.dnn


def random_networks(n: int) -> tuple[Genome, DnnSettings]:
    """N networks of the first generation."""
    settings = defaults_of(on_physics("mjx")).dnn
    return jax.vmap(dnn.random_genome, (0, None))(jax.random.split(jax.random.key(0), n), settings), settings


def random_policies(n: int) -> tuple[Any, qlearning.Problem]:
    """N random Q-networks over the actions and sensors that an expert designed."""
    task = on_physics("mjx")
    assert task.expert is not None
    inputs = qlearning.input_set(chosen_sensors(task.expert.sensors, task.sensors))
    actions = ActionSet(*map(jnp.asarray, task.expert.actions()))
    problem = qlearning.Problem(task, defaults_of(task).learner, task.source_domains("A"), actions, inputs)
    return jax.vmap(problem.new_networks)(jax.random.split(jax.random.key(0), n)), problem


def learned_policy(run: Run) -> tuple[Any, qlearning.Problem]:
    """The Q-networks of a run (B = 1)."""
    problem = problem_on(run, on_physics("mjx").source_domains("A"))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], read_networks(run, problem)), problem


def main() -> int:
    """Print a JSON object per kind of policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN", help="folder of a finished run of box pushing")
    parser.add_argument("--random", type=int, default=500, help="random networks, and as many random Q-networks")
    parser.add_argument("--seeds", type=int, default=1, help="episodes of each policy, from different starts")
    options = parser.parse_args()
    try:
        some = [runs.load(folder) for folder in options.runs]
        evolved = [("lineages", *lineages(some))] if some else []
    except RunError as error:
        print(error, file=sys.stderr)
        return 2
    for seed in range(options.seeds):
        for kind, *which in [*evolved, ("random networks", *random_networks(options.random))]:
            print(json.dumps({"kind": kind, "seed": seed, **agreement(*which, seed)}), flush=True)
        learned = [(f"learned by {run.folder.name}", *learned_policy(run)) for run in some if _has_learned(run)]
        for kind, *which in [*learned, ("random Q-networks", *random_policies(options.random))]:
            print(json.dumps({"kind": kind, "seed": seed, **agreement_of_policies(*which, seed)}), flush=True)
    return 0


def _has_learned(run: Run) -> bool:
    return run.file("qnets.npz").exists()


if __name__ == "__main__":
    sys.exit(main())
