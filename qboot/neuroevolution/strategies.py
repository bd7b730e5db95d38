"""The algorithms "cma_es", "open_es" and "snes": evolution strategies of evosax on the weights of one topology.

The topology is that of the first generation of DNN, every input to every output, or, in transfer, that of the network
to start from; the strategy searches its n weights and biases, divided by `weight_limit`. What lies beyond [-1, 1] acts
as the limit. The score alone is maximised: strategies have no use for behavioural diversity. Shape letters: P samples
a generation, n parameters.

A search distribution has no individuals that live on. Its lineage is made of its means: that of each generation is
evaluated beside the samples drawn around it, and descends from the mean before. A sample descends from its mean.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from qboot.keys import key
from qboot.neuroevolution import dnn
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.dnn import DnnSettings, Genome
from qboot.neuroevolution.lineage import NO_PARENT, Individuals
from qboot.neuroevolution.problem import EvolveInfo, Problem, evaluate_individuals

# Records the outcome alone, which costs nothing while a rollout runs.
RECORDER = DISTANCES["adhoc"].recorder
# Standard deviation at the start, in weight limits: that of the uniform weights of the first generation of DNN.
FIRST_SPREAD = 3**-0.5
# Open_ES keeps its spread, and climbs by Adam: steps of a weight at most, in weight limits.
OPEN_ES_SPREAD = 0.1
OPEN_ES_STEP = 0.03


class SearchState(NamedTuple):
    """What the next generation needs."""

    generation: int
    topology: Genome  # of all networks; its weights do not count
    distribution: np.ndarray  # (m,) float64, the numbers of evosax's state one after the other, exactly
    means: Individuals  # one per generation
    best: Individuals  # (1, ...) the best of all means and samples, as at its birth; of equals the youngest
    best_score: float  # its latest one: another than at its birth where it is evaluated again


def init(name: str, problem: Problem, front: Genome | None = None) -> tuple[SearchState, EvolveInfo]:
    """The first samples: around 0, or around the first network of a `front` (F, ...), which decides the topology.

    Raises:
        ValueError: if evosax is not installed, or the strategy cannot draw so many samples.
    """
    if front is None:
        topology = dnn.random_genome(jax.random.key(0), problem.dnn)
        mean = np.zeros(_n_parameters(topology), np.float32)
    else:
        topology = jax.tree.map(lambda leaf: np.asarray(leaf)[0], front)
        mean = _parameters(topology, problem.dnn)
    topology = jax.device_get(topology)
    strategy = _strategy(name, problem.settings.population, len(mean))
    distribution = _flat(strategy.init(key(problem.key, "search"), mean, _parameters_of(strategy)))
    nobody = _individuals(topology, np.zeros((0, len(mean))), problem.dnn)
    return _generation(name, problem, SearchState(0, topology, distribution, nobody, nobody, -np.inf))


def step(name: str, problem: Problem, state: SearchState) -> tuple[SearchState, EvolveInfo]:
    """One generation: samples around the mean, and the mean moved towards the better ones."""
    return _generation(name, problem, state._replace(generation=state.generation + 1))


def best_lineage(problem: Problem, state: SearchState) -> Individuals:
    """The means up to the one that the best individual was drawn around, and the best, last; `horizon` at most."""
    before = state.means.take(state.means.ids < state.best.ids[0])
    return Individuals.concatenate(before, state.best).take(slice(-problem.settings.horizon, None))


def pareto_front(state: SearchState) -> Individuals:
    """The best individual: with one objective, nothing else is undominated."""
    return state.best


def condensed(state: SearchState) -> SearchState:
    """The state itself."""
    return state


def restored(problem: Problem, saved: SearchState) -> SearchState:
    """The state itself."""
    return saved


def _generation(name: str, problem: Problem, state: SearchState) -> tuple[SearchState, EvolveInfo]:
    """Draw and evaluate the samples of `state.generation` and its mean, and tell the strategy their scores."""
    n = problem.settings.population
    strategy = _strategy(name, n, _n_parameters(state.topology))
    parameters = _parameters_of(strategy)
    asked = jax.random.fold_in(key(problem.key, "samples"), state.generation)
    drawn_from = _restored_distribution(strategy, state.distribution)
    samples, distribution = strategy.ask(asked, drawn_from, parameters)

    newborn = _individuals(state.topology, np.vstack([drawn_from.mean, samples]), problem.dnn)
    ids = state.generation * (n + 1) + np.arange(n + 1)
    parents = np.full(n + 1, ids[0])
    parents[0] = state.means.ids[-1] if len(state.means.ids) else NO_PARENT
    newborn = newborn._replace(ids=ids, parents=parents, births=np.full(n + 1, state.generation, np.int32))
    # Where starts are random, the best so far has to show it again, on the starts that the newborn get.
    again = problem.settings.reevaluate
    everyone = Individuals.concatenate(newborn, state.best) if again else newborn
    result = evaluate_individuals(problem, RECORDER, everyone, state.generation)
    scores = np.asarray(result.scores).sum(axis=1)
    newborn = newborn._replace(scores=scores[: n + 1])

    # evosax minimises.
    distribution, _ = strategy.tell(asked, samples, -newborn.scores[1:], distribution, parameters)
    known = np.full(len(state.best.ids), state.best_score)
    contest = np.concatenate([scores[n + 1 :] if again else known, newborn.scores])
    winner = np.flatnonzero(contest == contest.max())[-1:]
    state = state._replace(
        distribution=_flat(distribution),
        means=Individuals.concatenate(state.means, newborn.take(slice(0, 1))),
        best=Individuals.concatenate(state.best, newborn).take(winner),
        best_score=float(contest.max()),
    )
    return state, EvolveInfo(
        generation=state.generation,
        episodes=(state.generation + 1) * (n + 1) + again * state.generation,
        best=state.best_score,
        median=float(np.median(newborn.scores[1:])),
        mean=float(newborn.scores[1:].mean()),
        diversity="",
        lived=float(result.steps.mean() / problem.task.max_steps),
        connections=float(state.topology.connected.sum()),
        hidden=float(state.topology.hidden.sum()),
        refused=0,
    )


@cache
def _strategy(name: str, population: int, n_parameters: int) -> Any:
    """One object for equal arguments: evosax compiles anew for each."""
    try:
        from evosax.algorithms import CMA_ES, SNES, Open_ES
    except ImportError:
        raise ValueError(f"the algorithm {name!r} needs evosax: pip install 'qboot[alternatives]'") from None
    import optax

    solution = np.zeros(n_parameters, np.float32)
    if name == "open_es":
        if population % 2:
            raise ValueError(f"population is {population}: open_es draws samples in pairs, it must be even")
        return Open_ES(
            population,
            solution,
            optimizer=optax.adam(OPEN_ES_STEP),
            std_schedule=optax.constant_schedule(OPEN_ES_SPREAD),
        )
    return {"cma_es": CMA_ES, "snes": SNES}[name](population, solution)


def _parameters_of(strategy: Any) -> Any:
    """Evosax's own defaults, but for the first spread."""
    parameters = strategy.default_params
    return parameters.replace(std_init=np.float32(FIRST_SPREAD)) if hasattr(parameters, "std_init") else parameters


def _flat(distribution: Any) -> np.ndarray:
    """All numbers of evosax's state (m,), which double precision holds exactly."""
    return np.concatenate([np.ravel(np.asarray(leaf, np.float64)) for leaf in jax.tree.leaves(distribution)])


def _restored_distribution(strategy: Any, flat: np.ndarray) -> Any:
    """Evosax's state from its numbers (m,)."""
    mean = jax.ShapeDtypeStruct((strategy.num_dims,), np.float32)
    template = jax.eval_shape(strategy.init, jax.random.key(0), mean, _parameters_of(strategy))
    leaves, structure = jax.tree.flatten(template)
    parts = np.split(flat, np.cumsum([leaf.size for leaf in leaves])[:-1])
    values = [part.reshape(leaf.shape).astype(leaf.dtype) for part, leaf in zip(parts, leaves, strict=True)]
    return jax.tree.unflatten(structure, values)


def _neurons(topology: Genome) -> np.ndarray:
    """(K,) bool: outputs, and those hidden neurons that exist."""
    return np.append(np.ones(len(topology.biases) - len(topology.hidden), bool), topology.hidden)


def _n_parameters(topology: Genome) -> int:
    return int(topology.connected.sum() + _neurons(topology).sum())


def _parameters(genome: Genome, settings: DnnSettings) -> np.ndarray:
    """Weights and biases (n,) of a genome, in weight limits."""
    return np.append(genome.weights[genome.connected], genome.biases[_neurons(genome)]) / settings.weight_limit


def _individuals(topology: Genome, parameters: np.ndarray, settings: DnnSettings) -> Individuals:
    """Individuals with `parameters` (B, n), of which nothing else is known yet."""
    values = settings.weight_limit * np.clip(parameters, -1.0, 1.0).astype(np.float32)
    n, n_weights = len(values), int(topology.connected.sum())
    genomes = jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf)[None], n, axis=0), topology)
    weights, biases = np.zeros_like(genomes.weights), np.zeros_like(genomes.biases)
    weights[:, topology.connected] = values[:, :n_weights]
    biases[:, _neurons(topology)] = values[:, n_weights:]
    genomes, ids = genomes._replace(weights=weights, biases=biases), np.zeros(n, np.int64)
    rooms = np.full(n, dnn.least_room(genomes, settings), np.int32)
    return Individuals(genomes, ids, ids, np.zeros(n, np.int32), np.zeros(n, np.float32), rooms)
