"""Evolution strategies: their lineage, replay, resume and transfer, and that they find what they look for."""

import jax
import numpy as np
import pytest
from toy_tasks import RANDOM, assert_same, corridor

from qboot.extraction.traces import traces
from qboot.neuroevolution import strategies
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.problem import Problem
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.study.store import files

NAMES = ("cma_es", "open_es", "snes")
TASK = corridor((5, RANDOM), (0, RANDOM), max_steps=20, rollouts_per_domain=2)
DNN = DnnSettings(n_inputs=7, n_outputs=1)


@pytest.fixture(autouse=True)
def standard_promotion():
    """Evosax mixes kinds of numbers."""
    with jax.numpy_dtype_promotion("standard"):
        yield


def problem_with(name, **changed):
    settings = EvolutionSettings(algorithm=name, population=8, generations=4, **changed)
    return Problem(TASK, TASK.source_domains("A"), settings, DNN, jax.random.key(3), workers=1)


def run(problem, generations, front=None):
    algorithm = ALGORITHMS[problem.settings.algorithm]
    state, info = algorithm.init(problem, front)
    infos = [info]
    for _ in range(generations):
        state, info = algorithm.step(problem, state)
        infos.append(info)
    return state, infos


@pytest.mark.parametrize("reevaluate", [False, True])
def test_the_lineage_is_made_of_means_and_replays(reevaluate):
    problem = problem_with("snes", reevaluate=reevaluate)
    state, infos = run(problem, 4)
    lineage = ALGORITHMS["snes"].best_lineage(problem, state)
    assert infos[-1].best == state.best_score
    assert reevaluate or lineage.scores[-1] == max(info.best for info in infos)
    assert lineage.parents[0] == -1
    np.testing.assert_array_equal(lineage.parents[1:], lineage.ids[:-1])
    assert (np.diff(lineage.births)[:-1] == 1).all()
    _, scores = traces(problem, lineage)
    np.testing.assert_array_equal(scores, lineage.scores)
    assert [info.episodes for info in infos] == [9 * (i + 1) + reevaluate * i for i in range(5)]


def test_no_more_ancestors_than_the_horizon():
    problem = problem_with("snes", horizon=2)
    state, _ = run(problem, 4)
    assert len(ALGORITHMS["snes"].best_lineage(problem, state).ids) <= 2


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_search_goes_on_to_the_byte(name, tmp_path):
    problem, algorithm = problem_with(name), ALGORITHMS[name]
    half, _ = run(problem, 2)
    files.write_npz(tmp_path / "half.npz", files.to_arrays(algorithm.condensed(half)))
    saved = files.from_arrays(files.read_npz(tmp_path / "half.npz"), algorithm.saved, tmp_path)
    resumed = algorithm.restored(problem, saved)
    for _ in range(2):
        resumed, _ = algorithm.step(problem, resumed)
    whole, _ = run(problem, 4)
    assert_same(files.to_arrays(resumed), files.to_arrays(whole))


def test_transfer_starts_around_the_network_it_is_given():
    problem = problem_with("open_es")
    genome = jax.tree.map(lambda leaf: np.asarray(leaf)[None], strategies.dnn.random_genome(jax.random.key(1), DNN))
    state, _ = run(problem, 0, genome)
    first = state.means.genomes
    np.testing.assert_allclose(first.weights, genome.weights, rtol=1e-5)
    np.testing.assert_allclose(first.biases, genome.biases, rtol=1e-5)
    np.testing.assert_array_equal(first.connected, genome.connected)


def test_padding_and_the_limit_hold():
    state, _ = run(problem_with("cma_es"), 3)
    for some in (state.means.genomes, state.best.genomes):
        assert (np.abs(some.weights) <= DNN.weight_limit).all()
        assert not some.weights[~some.connected].any() and not some.biases[:, 1:].any()


@pytest.mark.parametrize("name", NAMES)
def test_a_minimum_is_found(name):
    """The strategies as they are set here, on a quadratic whose minimum is inside the weights' limits."""
    strategy = strategies._strategy(name, 16, 5)
    parameters, goal = strategies._parameters_of(strategy), np.linspace(-0.8, 0.8, 5)
    mean = np.zeros(5, np.float32)
    state = strategy.init(jax.random.key(0), mean, parameters)
    for i in range(150):
        state = strategies._restored_distribution(strategy, strategies._flat(state))
        samples, state = strategy.ask(jax.random.key(i), state, parameters)
        losses = np.square(np.asarray(samples) - goal).sum(axis=1).astype(np.float32)
        state, _ = strategy.tell(jax.random.key(i), samples, losses, state, parameters)
    np.testing.assert_allclose(state.mean, goal, atol=0.15)


def test_what_is_missing_is_said(monkeypatch):
    strategies._strategy.cache_clear()
    monkeypatch.setitem(__import__("sys").modules, "evosax.algorithms", None)
    with pytest.raises(ValueError, match=r"needs evosax: pip install 'qboot\[alternatives\]'"):
        run(problem_with("cma_es"), 0)


def test_pairs_need_an_even_population():
    settings = EvolutionSettings(algorithm="open_es", population=7)
    problem = Problem(TASK, TASK.source_domains("A"), settings, DNN, jax.random.key(3), workers=1)
    with pytest.raises(ValueError, match="population is 7: open_es draws samples in pairs"):
        ALGORITHMS["open_es"].init(problem, None)
