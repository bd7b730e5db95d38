"""The evolutionary run: records, lineage, resumption, independence of how it is spread over threads."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from conftest import promotion_for
from toy_tasks import CELLS, corridor

from qboot.envs import ball_collecting, box_pushing
from qboot.extraction.traces import traces
from qboot.neuroevolution import dnn, evaluation, evolve
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.lineage import NO_PARENT, Individuals, ancestors, best_of, lineage
from qboot.neuroevolution.problem import Problem, evaluate_individuals, evaluation_keys
from qboot.neuroevolution.recorders import FLOW
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.neuroevolution.variation import MutationRates

TASK = ball_collecting.TASK._replace(max_steps=130)
SETTINGS = EvolutionSettings(population=6, generations=4, diversity_period=2)


def problem(seed=0, workers=1, task=TASK, settings=SETTINGS):
    return Problem(task, task.source_domains("A"), settings, DnnSettings(), jax.random.key(seed), workers)


def run(problem, generations=4):
    state, info = evolve.init(problem)
    infos = [info]
    for _ in range(generations):
        state, info = evolve.step(problem, state)
        infos.append(info)
    return state, infos


def assert_same(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)


def test_a_run_repeats_itself_and_does_not_depend_on_threads():
    state, infos = run(problem())
    again, infos_again = run(problem(workers=3))
    assert_same(state, again)
    assert infos == infos_again


def test_behaviours_of_survivors_are_those_of_running_them_again():
    run_problem = problem()
    state, _ = run(run_problem, 3)
    assert_same(evolve.describe(run_problem, state.population, state.generation, state.room), state.behaviours)


@pytest.mark.parametrize(("newborn_first", "expected"), [(False, [0, 1, 3]), (True, [0, 2, 3])])
def test_of_equals_the_older_or_the_newborn_survive(monkeypatch, newborn_first, expected):
    """Four with the same scores and behaviours: the two ends of their front survive, and one of the others."""
    alike = SimpleNamespace(metric=lambda task, behaviours: np.zeros(4))
    monkeypatch.setattr(evolve, "DISTANCES", dict.fromkeys(SETTINGS.diversities, alike))
    settings = replace(SETTINGS, population=3, newborn_first=newborn_first)
    ids, none = np.arange(4), np.full(4, NO_PARENT)
    everyone = Individuals(np.zeros((4, 1)), ids, none, np.zeros(4, np.int32), np.zeros(4), np.full(4, 4))
    state = evolve.EvolveState(0, everyone, None, None, None, everyone.take(slice(0, 0)), 4, 4)
    state = evolve._survive(problem(settings=settings), state, everyone, np.arange(4))
    assert sorted(state.population.ids) == expected
    np.testing.assert_array_equal(state.behaviours, state.population.ids)
    assert (state.ranks == 0).all() and np.isinf(state.crowding[[0, 1]]).all() and state.crowding[2] == 0


def test_lineage_is_acyclic_and_leads_back_to_the_first_generation():
    state, _ = run(problem(), 4)
    best = best_of(state.population)
    line = lineage(state.archive, best, 500)
    assert line.ids[-1] == best and line.parents[0] == NO_PARENT and line.births[0] == 0
    assert (np.diff(line.ids) > 0).all() and (np.diff(line.births) > 0).all()
    np.testing.assert_array_equal(line.parents[1:], line.ids[:-1])
    assert len(lineage(state.archive, best, 2).ids) == min(2, len(line.ids))
    assert line.scores[-1] == state.population.scores.max()


def test_the_archive_keeps_ancestors_and_nothing_else():
    parents = np.array([NO_PARENT, NO_PARENT, 0, 1, 2, 2])
    genomes = jax.tree.map(
        np.asarray,
        jax.vmap(dnn.random_genome, in_axes=(0, None))(jax.random.split(jax.random.key(0), 6), DnnSettings()),
    )
    parents, nothing = np.where(parents < 0, parents, parents * 10), np.zeros(6)
    archive = Individuals(genomes, np.arange(6) * 10, parents, nothing, nothing, nothing)
    np.testing.assert_array_equal(ancestors(archive, np.array([50])), [True, False, True, False, False, True])
    with pytest.raises(ValueError, match="individual 7"):
        lineage(archive, 7, 5)


def test_diversity_is_drawn_anew_each_period():
    settings = EvolutionSettings(population=6, diversity_period=10)
    drawn = [evolve.diversity_in_force(problem(settings=settings), g) for g in range(400)]
    for period in range(40):
        assert len(set(drawn[10 * period : 10 * period + 10])) == 1
    assert set(drawn) == set(settings.diversities)


def test_transfer_starts_from_the_front():
    state, _ = run(problem(), 2)
    front = evolve.pareto_front(state).genomes
    # Without mutation the first population is made of the front alone.
    unchanged = EvolutionSettings(population=6, rates=MutationRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    started, _ = evolve.init(problem(seed=9, settings=unchanged), front)
    known = {weights.tobytes() for weights in front.weights}
    assert {weights.tobytes() for weights in started.population.genomes.weights} <= known
    assert len(started.population.ids) == 6


def test_survivors_face_the_starts_of_their_generation():
    """Re-evaluation against evaluating each generation by hand; the archive keeps the scores of birth."""
    robot = box_pushing.on_physics("kinematic")
    settings = EvolutionSettings(population=6, reevaluate=True)
    pushing = Problem(robot, robot.source_domains("A"), settings, DnnSettings(feed_forward=True), jax.random.key(3), 1)
    state, info = evolve.init(pushing)
    births = dict(zip(state.archive.ids.tolist(), state.archive.scores.tolist(), strict=True))
    assert info.episodes == 12
    for generation in (1, 2, 3):
        state, info = evolve.step(pushing, state)
        assert info.episodes == 12 + 12 * generation
        keys = evaluation_keys(pushing, state.population, generation)
        assert len(np.unique(jax.random.key_data(keys), axis=0)) == 1
        recorder = DISTANCES[evolve.diversity_in_force(pushing, generation)].recorder
        genomes = state.population.genomes
        again = evaluation.evaluate_all(
            robot, pushing.dnn, recorder, pushing.domains, genomes, keys, workers=1, room=state.room
        )
        np.testing.assert_array_equal(again.scores.sum(axis=1), state.population.scores)
        for place, identity in enumerate(state.archive.ids.tolist()):
            if state.archive.births[place] < generation:
                assert births[identity] == state.archive.scores[place]
            births[identity] = float(state.archive.scores[place])


@pytest.mark.parametrize("name", DISTANCES)
def test_records_are_those_of_the_whole_flow(name):
    """Each descriptor, made step by step in the compiled loop, against the same made from the recorded flow."""
    task = ball_collecting.TASK._replace(max_steps=600)
    genomes = jax.vmap(dnn.random_genome, in_axes=(0, None))(jax.random.split(jax.random.key(3), 4), DnnSettings())
    keys = jax.random.split(jax.random.key(4), 4)
    domains = task.source_domains("A")
    result = evaluation.evaluate(task, DnnSettings(), DISTANCES[name].recorder, domains, genomes, keys)
    flow = evaluation.evaluate(task, DnnSettings(), FLOW, domains, genomes, keys)
    observations, commands = flow.descriptors
    channels = np.concatenate([observations, commands], axis=-1)
    lived = np.arange(600) < np.asarray(flow.steps)[..., None]
    assert (~lived).any(), "one of these controllers should stand still and end its test"
    descriptor = np.asarray(result.descriptors)
    if name == "hamming":
        bits = ((channels >= 0.5) * (1 << np.arange(16))).sum(axis=-1)
        np.testing.assert_array_equal(descriptor, np.where(lived, bits, 0)[..., None])
    elif name == "entropy":
        np.testing.assert_array_equal(descriptor.sum(axis=-1), np.repeat(flow.steps[..., None], 16, axis=-1))
        first = np.histogram(channels[0, 0, : flow.steps[0, 0], 0], bins=np.arange(10) / 9)[0]
        np.testing.assert_array_equal(descriptor[0, 0, 0], first)
    elif name == "trajectory":
        assert descriptor.shape == (4, 2, 12)
        np.testing.assert_array_equal(descriptor >= 0, lived[..., ::50])
        start = task.reset(None, jax.tree.map(lambda leaf: leaf[1], domains))
        assert (descriptor[:, 1, 0] == int(task.position(jax.tree.map(lambda leaf: leaf[1], domains), start))).all()
    else:
        assert descriptor.shape == (4, 2, 8)


def test_blocks_do_not_change_results():
    task, network = corridor((5, 1), (2, 4)), DnnSettings(n_inputs=CELLS + 1, n_outputs=1)
    genomes = jax.device_get(
        jax.vmap(dnn.random_genome, in_axes=(0, None))(jax.random.split(jax.random.key(0), 7), network)
    )
    keys = jax.random.split(jax.random.key(1), 7)
    parts = task, network, DISTANCES["hamming"].recorder, task.source_domains("A")
    function = jax.jit(lambda genomes, keys: evaluation.evaluate(*parts, genomes, keys))
    assert_same(
        evaluation.in_blocks(function, 1, 3, genomes, keys),
        evaluation.in_blocks(function, 2, 5, genomes, keys),
    )


@pytest.mark.parametrize(
    "name", ["adhoc", *(pytest.param(name, marks=pytest.mark.slow) for name in DISTANCES if name != "adhoc")]
)
def test_the_evaluation_loop_is_one_kernel(name):
    """XLA compiles the loop into one call; without that, a simulation is about twice as slow."""
    genomes = jax.vmap(dnn.random_genome, in_axes=(0, None))(jax.random.split(jax.random.key(0), 4), DnnSettings())
    keys = jax.random.split(jax.random.key(1), 4)
    parts = TASK, DnnSettings(), DISTANCES[name].recorder, TASK.source_domains("A")
    program = evaluation.evaluate.lower(*parts, genomes, keys).compile().as_text()
    assert "xla_cpu_small_call" in program


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population": 1}, "population is 1: it must be at least 2"),
        ({"diversity_period": 0}, "diversity_period is 0"),
        ({"horizon": 0}, "horizon is 0"),
        ({"algorithm": "luck"}, "algorithm is 'luck': it must be one of nsga2"),
        ({"generations": -1}, "generations is -1"),
        ({"diversities": ("taste",)}, "taste"),
    ],
)
def test_bad_settings_are_named(change, words):
    with pytest.raises(ValueError, match=words):
        EvolutionSettings(**change)


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (DnnSettings(n_inputs=7), "n_inputs is 7, but ball_collecting has 13 sensors: it must be 13"),
        (DnnSettings(n_outputs=2), "n_outputs is 2, but ball_collecting has 3 effectors: it must be 3"),
    ],
)
def test_networks_that_do_not_fit_the_task_are_refused(network, words):
    with pytest.raises(ValueError, match=words):
        Problem(TASK, TASK.source_domains("A"), SETTINGS, network, jax.random.key(0), 1)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_resumes_and_gives_a_lineage_that_replays(name):
    with promotion_for(name):
        assert_it_resumes_and_replays(name)


def assert_it_resumes_and_replays(name):
    algorithm, run_problem = ALGORITHMS[name], problem(settings=replace(SETTINGS, algorithm=name, horizon=3))
    state, _ = algorithm.init(run_problem, None)
    saved = jax.tree.map(lambda leaf: leaf if isinstance(leaf, int) else np.asarray(leaf), algorithm.condensed(state))
    state, info = algorithm.step(run_problem, state)
    resumed, info_resumed = algorithm.step(run_problem, algorithm.restored(run_problem, saved))
    assert_same(state, resumed)
    assert info == info_resumed and info.generation == state.generation == 1
    line = algorithm.best_lineage(run_problem, state)
    assert 1 <= len(line.ids) <= 3
    assert line.scores[-1] >= algorithm.pareto_front(state).scores.max()
    flow, scores = traces(run_problem, line)
    np.testing.assert_array_equal(scores, line.scores)
    assert len(flow) == 2 * len(line.ids)


def test_a_lineage_is_played_again_in_the_rooms_of_its_births():
    """To the bit what each network does alone in its room, in the order of the lineage."""
    run_problem = problem()
    state, _ = run(run_problem, 2)
    line = state.population._replace(rooms=np.array([4, 20, 4, 4, 20, 20]))
    flow, scores = traces(run_problem, line)
    for policy in range(6):
        one = line.take(slice(policy, policy + 1))
        alone = evaluation_of(run_problem, one, int(line.rooms[policy]))
        assert scores[policy] == alone.scores.sum()
        for rollout, length in enumerate(alone.steps[0]):
            expected = jax.tree.map(lambda leaf, r=rollout, n=length: leaf[0, r, :n], alone.descriptors)
            assert_same(tuple(flow[2 * policy + rollout]), expected)


def evaluation_of(problem, individuals, room):
    return evaluate_individuals(problem, FLOW, individuals, individuals.births, room)
