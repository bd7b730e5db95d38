"""How long is the lineage of the best-of-run, and which tie rules make it longer?

    python experiments/lineages.py --generations 200 --seeds 2

evolves the arm on its closed-form physics, with either rule for ties in survival, and prints a line of Markdown per
rule and seed: the length of the lineage of the youngest and of the oldest of the best (without a horizon), after how
many generations each was born, and the mean age at which an ancestor had the next one.
"""

import argparse
import dataclasses
import sys

import jax
import numpy as np

from qboot.envs import get_task
from qboot.neuroevolution import evolve
from qboot.neuroevolution.lineage import Individuals, lineage
from qboot.neuroevolution.problem import Problem
from qboot.study.pipeline import profiles


def evolved(newborn_first: bool, generations: int, seed: int) -> evolve.EvolveState:
    """The end of an evolution of the arm."""
    settings = profiles.settings_of("box_pushing", "standard", "A", seed)
    task = get_task("box_pushing", "kinematic")._replace(max_steps=settings.n_steps)
    evolution = dataclasses.replace(settings.evolution, newborn_first=newborn_first, generations=generations)
    problem = Problem(task, task.source_domains("A"), evolution, settings.dnn, jax.random.key(seed), workers=1)
    state, _ = evolve.init(problem)
    for _ in range(generations):
        state, _ = evolve.step(problem, state)
    return state


def of_best(state: evolve.EvolveState, youngest: bool) -> Individuals:
    """The whole lineage of the youngest or the oldest of the best."""
    some = state.population
    best = some.ids[some.scores == some.scores.max()]
    return lineage(state.archive, int(best.max() if youngest else best.min()), horizon=10**6)


def main() -> int:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    print("| of equals survive | seed | youngest best: length (born) | oldest best: length (born) | mean age |")
    print("|---|---|---|---|---|", flush=True)
    for newborn_first in (False, True):
        for seed in range(options.seeds):
            state = evolved(newborn_first, options.generations, seed)
            young, old = (of_best(state, youngest) for youngest in (True, False))
            lengths = " | ".join(f"{len(each.ids)} ({each.births[-1]})" for each in (young, old))
            age = np.diff(young.births).mean()
            print(f"| {'newborn' if newborn_first else 'older'} | {seed} | {lengths} | {age:.1f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
