"""Do evolved networks of box pushing score the same on both physics?

    python experiments/agreement.py RUN [RUN ...]

Every network of the lineages of finished runs is tested on MuJoCo (mjx) and on its closed-form twin (kinematic), from
the same random starts on the source blocks. Prints one JSON object:

    networks, tests           how many
    outcome_agreement         share of tests that end alike: pushed, touched otherwise, or not touched
    largest_score_difference  between the two scores (of 15) that a network has
    score_mjx, score_kinematic  means over the networks
"""

import argparse
import json
import sys
from functools import partial
from pathlib import Path

import jax
import numpy as np

from qboot.envs.box_pushing import PHYSICS, on_physics
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.dnn import DnnSettings, Genome
from qboot.neuroevolution.recorders import FLOW
from qboot.study.store import runs
from qboot.study.store.artifacts import read_lineage
from qboot.study.store.files import RunError


def rollouts(physics: str, genomes: Genome, settings: DnnSettings, seed: int) -> evaluation.Evaluation:
    """One episode of B networks on the source blocks; the same `seed` gives the same starts on any physics."""
    keys = jax.random.split(jax.random.key(seed), len(genomes.weights))
    robot = on_physics(physics)
    function = partial(evaluation.evaluate, robot, settings, FLOW, robot.source_domains("A"))
    return evaluation.in_blocks(function, 1, genomes, keys)._replace(descriptors=None)


def agreement(genomes: Genome, settings: DnnSettings, seed: int = 0) -> dict[str, float]:
    """The figures that this script prints, for B networks."""
    mjx, kinematic = (rollouts(physics, genomes, settings, seed) for physics in PHYSICS)
    longest = on_physics("mjx").max_steps

    def ends(result: evaluation.Evaluation) -> np.ndarray:
        """0 not touched, 1 touched, 2 pushed; a touch in the very last step counts as not touched."""
        return np.where(result.scores > 0, 2, result.steps < longest)

    scores = [result.scores.sum(axis=1) for result in (mjx, kinematic)]
    return {
        "networks": len(scores[0]),
        "rollouts": mjx.scores.size,
        "outcome_agreement": float((ends(mjx) == ends(kinematic)).mean()),
        "largest_score_difference": float(np.abs(scores[0] - scores[1]).max()),
        "score_mjx": float(scores[0].mean()),
        "score_kinematic": float(scores[1].mean()),
    }


def lineages(some: list[Path]) -> tuple[Genome, DnnSettings]:
    """All networks of the lineages of runs, which must share their settings.

    Raises:
        RunError: if a folder is no run of box pushing that has evolved, or the topologies differ.
    """
    found = [runs.load(folder) for folder in some]
    for run in found:
        if run.settings.task != "box_pushing":
            raise RunError(f"{run.folder} is a run of {run.settings.task}: give runs of box_pushing")
        if run.settings.dnn != found[0].settings.dnn:
            raise RunError(f"{run.folder} has networks with other settings than {found[0].folder}: compare them apart")
    genomes = [read_lineage(run).genomes for run in found]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *genomes), found[0].settings.dnn


def main() -> int:
    """Print the JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a finished run of box pushing")
    parser.add_argument("--seed", type=int, default=0, help="of the starts")
    options = parser.parse_args()
    try:
        print(json.dumps(agreement(*lineages(options.runs), options.seed)))
    except RunError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
