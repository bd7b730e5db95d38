"""Neuro-evolution: NSGA-II on score and behavioural diversity, with DNN (paper, sections III-B and IV-A).

`init` and `step` are the whole algorithm. Their state lives on the host; evaluation, ranking and mutation are
compiled. Everything random comes from the run's key by `fold_in` of a generation or an individual's id, so a run
resumed from a saved state goes on as if it had never stopped.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.task import Domain, Task
from qboot.neuroevolution import dnn, evaluation, nsga2, variation
from qboot.neuroevolution.behaviour import RECORDERS
from qboot.neuroevolution.diversity import DIVERSITIES
from qboot.neuroevolution.dnn import Genome, Topology
from qboot.neuroevolution.lineage import NO_PARENT, Individuals, ancestors
from qboot.neuroevolution.variation import MutationRates


@dataclass(frozen=True)
class EvolutionSettings:
    """Parameters of neuro-evolution (appendix B)."""

    population: int = 128
    """Individuals that survive a generation, and children born in it."""
    generations: int = 1000
    """Generations after the first."""
    diversity_period: int = 50
    """Generations after which the behavioural distance in force is drawn anew."""
    diversities: tuple[str, ...] = ("adhoc", "hamming", "entropy", "trajectory")
    """Behavioural distances to draw from."""
    horizon: int = 500
    """H: ancestors kept in the lineage of the best-of-run, itself included."""
    rates: MutationRates = field(default_factory=MutationRates)
    reevaluate: bool = False
    """Evaluate survivors again in every generation, all on the same starts as the newborn. For tasks that start at
    random: an individual that was lucky once does not stay for its luck. It doubles the episodes."""

    def __post_init__(self):
        """Reject sizes that make no population."""
        for name in ("population", "diversity_period", "horizon"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least 1")
        if self.generations < 0:
            raise ValueError(f"generations is {self.generations}: it must not be negative")
        unknown = set(self.diversities) - set(DIVERSITIES)
        if unknown or not self.diversities:
            raise ValueError(f"diversities must be among {', '.join(DIVERSITIES)}, not {sorted(unknown) or 'none'}")


class Problem(NamedTuple):
    """What is evolved, where and from which seed: all that stays the same in a run."""

    task: Task
    domains: Domain
    settings: EvolutionSettings
    topology: Topology
    key: jax.Array
    workers: int  # threads; does not change results


class EvolveState(NamedTuple):
    """What the next generation needs."""

    generation: int
    population: Individuals
    behaviours: np.ndarray  # (P, n, ...) descriptions for the distance in force
    ranks: np.ndarray  # (P,) fronts among parents and children
    crowding: np.ndarray  # (P,)
    archive: Individuals  # all ancestors of the population, sorted by id
    next_id: int


class EvolveInfo(NamedTuple):
    """What is logged of a generation."""

    generation: int
    episodes: int  # evaluations so far
    best: float
    median: float
    mean: float
    diversity: str  # distance in force
    lived: float  # share of max_steps that those evaluated lived on average
    connections: float  # mean of the population
    hidden: float  # mean of the population
    refused: int  # mutations refused for want of room


def diversity_in_force(problem: Problem, generation: int) -> str:
    """The behavioural distance of a generation, drawn anew every `diversity_period` generations."""
    choices = problem.settings.diversities
    period = generation // problem.settings.diversity_period
    return choices[int(jax.random.randint(_key(problem, "diversity", period), (), 0, len(choices)))]


def init(problem: Problem, ancestors_front: Genome | None = None) -> tuple[EvolveState, EvolveInfo]:
    """The first population: the better half of twice its size.

    Random networks, or, when `ancestors_front` (F, ...) is given, that Pareto front and mutants of it (transfer).
    """
    n = 2 * problem.settings.population
    ids = np.arange(n)
    keys = _keys(problem, "first", ids)
    refused = 0
    if ancestors_front is None:
        genomes = jax.device_get(_random_genomes(keys, problem.topology))
    else:
        front = jax.tree.map(lambda leaf: np.asarray(leaf)[ids % len(leaf)], ancestors_front)
        mutants, _ = jax.device_get(_mutants(keys, front, problem.topology, problem.settings.rates))
        is_front = ids < len(ancestors_front.weights)
        genomes = jax.tree.map(lambda a, b: np.where(evaluation.expand(is_front, a), a, b), front, mutants)
    newborn = _unborn(genomes, ids, np.full(n, NO_PARENT), 0)
    newborn, behaviours, lived = _evaluated(problem, newborn, 0)
    state = EvolveState(0, newborn, behaviours, np.zeros(n), np.zeros(n), newborn.take(slice(0, 0)), n)
    state = _survive(problem, state, newborn, behaviours)
    return state, _info(problem, state, lived, refused)


def step(problem: Problem, state: EvolveState) -> tuple[EvolveState, EvolveInfo]:
    """One generation: parents by tournament, mutated children, survivors of both."""
    n = problem.settings.population
    generation = state.generation + 1
    ids = state.next_id + np.arange(n)
    chosen = jax.device_get(_tournament(_key(problem, "tournament", generation), state.ranks, state.crowding, n))
    parents = state.population.take(chosen)
    genomes, refused = jax.device_get(
        _mutants(_keys(problem, "mutation", ids), parents.genomes, problem.topology, problem.settings.rates)
    )
    children = _unborn(genomes, ids, parents.ids, generation)
    if problem.settings.reevaluate:
        everyone = Individuals.concatenate(state.population, children)
        everyone, behaviours, lived = _evaluated(problem, everyone, generation)
    else:
        if diversity_in_force(problem, generation) != diversity_in_force(problem, state.generation):
            state = state._replace(behaviours=describe(problem, state.population, generation))
        children, behaviours, lived = _evaluated(problem, children, generation)
        everyone = Individuals.concatenate(state.population, children)
        behaviours = np.concatenate([state.behaviours, behaviours])
    state = state._replace(generation=generation, next_id=state.next_id + n)
    state = _survive(problem, state, everyone, behaviours)
    return state, _info(problem, state, lived, int(refused.sum()))


def describe(problem: Problem, individuals: Individuals, generation: int) -> np.ndarray:
    """Behaviours of individuals as `generation` sees them, by running them again, to the bit."""
    return _evaluate(problem, individuals, generation).descriptions


def evaluation_keys(problem: Problem, individuals: Individuals, generation: int | np.ndarray) -> jax.Array:
    """The random keys (B,) that individuals are evaluated with in `generation`, or (B,) in the generation of each.

    Starts depend on the individual alone, or, when all are evaluated again, on the generation alone.
    """
    numbers = generation if problem.settings.reevaluate else individuals.ids
    return _keys(problem, "evaluation", np.broadcast_to(numbers, individuals.ids.shape))


def pareto_front(state: EvolveState) -> Individuals:
    """The non-dominated individuals of the population."""
    return state.population.take(state.ranks == state.ranks.min())


def _survive(problem: Problem, state: EvolveState, everyone: Individuals, behaviours: np.ndarray) -> EvolveState:
    """Selection: objectives, ranks and crowding over everyone; the archive keeps the survivors' ancestors."""
    diversity = DIVERSITIES[diversity_in_force(problem, state.generation)](behaviours)
    objectives = np.stack([everyone.scores, np.asarray(diversity)], axis=1)
    ranks, crowding, chosen = jax.device_get(_select(objectives, problem.settings.population))
    survivors = everyone.take(chosen)
    # Only those not archived yet, in order of their ids.
    new = everyone.ids > (state.archive.ids[-1] if len(state.archive.ids) else -1)
    archive = Individuals.concatenate(state.archive, everyone.take(new))
    archive = archive.take(ancestors(archive, survivors.ids))
    return state._replace(
        population=survivors,
        behaviours=behaviours[chosen],
        ranks=ranks[chosen],
        crowding=crowding[chosen],
        archive=archive,
    )


def _unborn(genomes: Genome, ids: np.ndarray, parents: np.ndarray, generation: int) -> Individuals:
    """Individuals that nothing is known of yet."""
    return Individuals(genomes, ids, parents, np.full(len(ids), generation, np.int32), np.zeros(len(ids), np.float32))


def _evaluated(problem: Problem, some: Individuals, generation: int) -> tuple[Individuals, np.ndarray, float]:
    result = _evaluate(problem, some, generation)
    lived = float(result.steps.mean() / problem.task.max_steps)
    return some._replace(scores=result.scores.sum(axis=1)), result.descriptions, lived


def _evaluate(problem: Problem, some: Individuals, generation: int) -> evaluation.Evaluation:
    recorder = RECORDERS[diversity_in_force(problem, generation)]
    function = partial(evaluation.evaluate, problem.task, problem.topology, recorder, problem.domains)
    return evaluation.in_blocks(function, problem.workers, some.genomes, evaluation_keys(problem, some, generation))


@partial(jax.jit, static_argnums=1)
def _select(objectives: jax.Array, n: int):
    ranks = nsga2.non_dominated_rank(objectives)
    crowding = nsga2.crowding_distance(objectives, ranks)
    return ranks, crowding, nsga2.survivors(ranks, crowding, n)


_tournament = jax.jit(nsga2.tournament, static_argnums=3)
_random_genomes = jax.jit(jax.vmap(dnn.random_genome, in_axes=(0, None)), static_argnums=1)
_mutants = jax.jit(jax.vmap(variation.mutate, in_axes=(0, 0, None, None)), static_argnums=(2, 3))

_PURPOSES = ("diversity", "first", "tournament", "mutation", "evaluation")


def _key(problem: Problem, purpose: str, number: int) -> jax.Array:
    return jax.random.fold_in(jax.random.fold_in(problem.key, _PURPOSES.index(purpose)), number)


def _keys(problem: Problem, purpose: str, ids: np.ndarray) -> jax.Array:
    return _fold_in(jax.random.fold_in(problem.key, _PURPOSES.index(purpose)), jnp.asarray(ids, jnp.uint32))


_fold_in = jax.jit(jax.vmap(jax.random.fold_in, in_axes=(None, 0)))


def _info(problem: Problem, state: EvolveState, lived: float, refused: int) -> EvolveInfo:
    scores = state.population.scores
    again = state.generation * problem.settings.population if problem.settings.reevaluate else 0
    return EvolveInfo(
        generation=state.generation,
        episodes=state.next_id + again,
        best=float(scores.max()),
        median=float(np.median(scores)),
        mean=float(scores.mean()),
        diversity=diversity_in_force(problem, state.generation),
        lived=lived,
        connections=float(state.population.genomes.connected.sum(axis=1).mean()),
        hidden=float(state.population.genomes.hidden.sum(axis=1).mean()),
        refused=refused,
    )
