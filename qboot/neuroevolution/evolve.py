"""The algorithm "nsga2": NSGA-II on score and behavioural diversity, with DNN (paper, sections III-B and IV-A).

`init` and `step` are the whole of it. Their state lives on the host; evaluation, ranking and mutation are
compiled. Everything random comes from the run's key by a stream's name and a generation or an individual's id, so a run
resumed from a saved state goes on as if it had never stopped.
"""

from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from qboot.keys import key, keys
from qboot.neuroevolution import dnn, nsga2, variation
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.dnn import Genome
from qboot.neuroevolution.evaluation import BLOCK, Evaluation, expand, in_blocks
from qboot.neuroevolution.lineage import NO_PARENT, Individuals, ancestors, best_of, lineage
from qboot.neuroevolution.problem import EvolveInfo, Problem, evaluate_individuals


class EvolveState(NamedTuple):
    """What the next generation needs. P individuals, n rollouts of each."""

    generation: int
    population: Individuals
    behaviours: np.ndarray  # (P, n, ...) descriptors for the distance in force
    ranks: np.ndarray  # (P,) fronts among parents and children
    crowding: np.ndarray  # (P,)
    archive: Individuals  # all ancestors of the population, sorted by id
    next_id: int
    room: int  # for hidden neurons, of the program that gave the behaviours


class SavedState(NamedTuple):
    """An `EvolveState` without its behaviours: they are large and come back by running the population again."""

    generation: int
    population: Individuals
    ranks: np.ndarray
    crowding: np.ndarray
    archive: Individuals
    next_id: int
    room: int


def diversity_in_force(problem: Problem, generation: int) -> str:
    """The behavioural distance of a generation, drawn anew every `diversity_period` generations (section III-B2)."""
    choices = problem.settings.diversities
    period = generation // problem.settings.diversity_period
    drawn = jax.random.randint(jax.random.fold_in(key(problem.key, "diversity"), period), (), 0, len(choices))
    return choices[int(drawn)]


def init(problem: Problem, front: Genome | None = None) -> tuple[EvolveState, EvolveInfo]:
    """The first population: the better half of twice its size.

    Random networks, or, when a `front` (F, ...) is given, that Pareto front and mutants of it (transfer).
    """
    n = 2 * problem.settings.population
    ids = np.arange(n)
    first_keys = keys(problem.key, "first", ids)
    refused = np.zeros(n, np.int32)
    if front is None:
        genomes = jax.device_get(_random_genomes(first_keys, problem.dnn))
    else:
        parents = jax.tree.map(lambda leaf: np.asarray(leaf)[ids % len(leaf)], front)
        mutants, refused = _mutated(problem, first_keys, parents)
        is_front = ids < len(front.weights)
        refused = np.where(is_front, 0, refused)
        genomes = jax.tree.map(lambda a, b: np.where(expand(is_front, a), a, b), parents, mutants)
    newborn = _unborn(genomes, ids, np.full(n, NO_PARENT), 0)
    room = dnn.least_room(newborn.genomes, problem.dnn)
    newborn, behaviours, lived = _evaluated(problem, newborn, 0, room)
    state = EvolveState(0, newborn, behaviours, np.zeros(n), np.zeros(n), newborn.take(slice(0, 0)), n, room)
    state = _survive(problem, state, newborn, behaviours)
    return state, _info(problem, state, lived, int(refused.sum()))


def step(problem: Problem, state: EvolveState) -> tuple[EvolveState, EvolveInfo]:
    """One generation: parents by tournament, mutated children, survivors of both."""
    n = problem.settings.population
    generation = state.generation + 1
    ids = state.next_id + np.arange(n)
    tournament_key = jax.random.fold_in(key(problem.key, "tournament"), generation)
    chosen = jax.device_get(_tournament(tournament_key, state.ranks, state.crowding, n))
    parents = state.population.take(chosen)
    genomes, refused = _mutated(problem, keys(problem.key, "mutation", ids), parents.genomes)
    children = _unborn(genomes, ids, parents.ids, generation)
    is_new_distance = diversity_in_force(problem, generation) != diversity_in_force(problem, state.generation)
    # A new distance, or more room, is another program, which describes the survivors anew: what is compared comes from
    # one program, and so does what a resumed run computes again. So room is given up with a distance alone.
    rooms = [dnn.least_room(some.genomes, problem.dnn) for some in (state.population, children)]
    room = max(*rooms, 0 if is_new_distance else state.room)
    if problem.settings.reevaluate:
        everyone = Individuals.concatenate(state.population, children)
        everyone, behaviours, lived = _evaluated(problem, everyone, generation, room)
    else:
        if is_new_distance or room != state.room:
            state = state._replace(behaviours=describe(problem, state.population, generation, room))
        children, behaviours, lived = _evaluated(problem, children, generation, room)
        everyone = Individuals.concatenate(state.population, children)
        behaviours = np.concatenate([state.behaviours, behaviours])
    state = state._replace(generation=generation, next_id=state.next_id + n, room=room)
    state = _survive(problem, state, everyone, behaviours)
    return state, _info(problem, state, lived, int(refused.sum()))


def describe(problem: Problem, individuals: Individuals, generation: int, room: int) -> np.ndarray:
    """Behaviours of individuals as `generation` sees them, by running them again in the same `room`, to the bit."""
    return _evaluate(problem, individuals, generation, room).descriptors


def pareto_front(state: EvolveState) -> Individuals:
    """The non-dominated individuals of the population."""
    return state.population.take(state.ranks == state.ranks.min())


def best_lineage(problem: Problem, state: EvolveState) -> Individuals:
    """The lineage of the best-of-run, oldest first (section IV-A)."""
    return lineage(state.archive, best_of(state.population), problem.settings.horizon)


def condensed(state: EvolveState) -> SavedState:
    """What must be saved of a state."""
    return SavedState(*(getattr(state, name) for name in SavedState._fields))


def restored(problem: Problem, saved: SavedState) -> EvolveState:
    """The state that was saved, to the bit."""
    return EvolveState(**saved._asdict(), behaviours=describe(problem, saved.population, saved.generation, saved.room))


def _survive(problem: Problem, state: EvolveState, everyone: Individuals, behaviours: np.ndarray) -> EvolveState:
    """Selection: objectives, ranks and crowding over everyone; the archive keeps the survivors' ancestors."""
    diversity = DISTANCES[diversity_in_force(problem, state.generation)].metric(problem.task, behaviours)
    objectives = np.stack([everyone.scores, np.asarray(diversity)], axis=1)
    # Parents come before children, and of equals the first survives.
    order = np.arange(len(objectives))[:: -1 if problem.settings.newborn_first else 1]
    ranks, crowding, chosen = jax.device_get(_select(objectives[order], problem.settings.population))
    chosen, ranks, crowding = order[chosen], ranks[order], crowding[order]  # a reversal undoes itself
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
    births, rooms = np.full(len(ids), generation, np.int32), np.zeros(len(ids), np.int32)
    return Individuals(genomes, ids, parents, births, np.zeros(len(ids), np.float32), rooms)


def _evaluated(
    problem: Problem, some: Individuals, generation: int, room: int
) -> tuple[Individuals, np.ndarray, float]:
    result = _evaluate(problem, some, generation, room)
    lived = float(result.steps.mean() / problem.task.max_steps)
    scores, rooms = np.asarray(result.scores).sum(axis=1), np.full_like(some.rooms, room)
    return some._replace(scores=scores, rooms=rooms), result.descriptors, lived


def _evaluate(problem: Problem, some: Individuals, generation: int, room: int) -> Evaluation:
    recorder = DISTANCES[diversity_in_force(problem, generation)].recorder
    return evaluate_individuals(problem, recorder, some, generation, room, min(BLOCK, problem.settings.population))


def _mutated(problem: Problem, mutation_keys: jax.Array, genomes: Genome) -> tuple[Genome, np.ndarray]:
    """Mutants of genomes (n, ...), and how many mutations of each were refused; a population's worth in each call, for
    another number is another program.
    """

    def mutants(some_keys: jax.Array, some: Genome) -> tuple[Genome, jax.Array]:
        return _mutants(some_keys, some, problem.dnn, problem.settings.rates)

    return in_blocks(mutants, 1, problem.settings.population, mutation_keys, genomes)


@partial(jax.jit, static_argnums=1)
def _select(objectives: jax.Array, n: int):
    ranks = nsga2.non_dominated_rank(objectives)
    crowding = nsga2.crowding_distance(objectives, ranks)
    return ranks, crowding, nsga2.survivors(ranks, crowding, n)


_tournament = jax.jit(nsga2.tournament, static_argnums=3)
_random_genomes = jax.jit(jax.vmap(dnn.random_genome, in_axes=(0, None)), static_argnums=1)
_mutants = jax.jit(jax.vmap(variation.mutate, in_axes=(0, 0, None, None)), static_argnums=(2, 3))


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
