"""Behavioural distances against pairwise brute force."""

import itertools
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qboot.neuroevolution import distances
from qboot.neuroevolution.recorders import Timestep


def pairwise(individuals, distance):
    """Mean distance of each to all."""
    return np.array([np.mean([distance(a, b) for b in individuals]) for a in individuals])


def edit_distance(a, b):
    """Levenshtein's dynamic programme, unit costs."""
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        previous, row[0] = row[0], i
        for j, y in enumerate(b, 1):
            previous, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, previous + (x != y))
    return row[-1]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([1, 2, 9]), st.sampled_from([3, 16, 32, 43]))
def test_hamming(seed, n, n_channels):
    """Of as many channels as there are, in words of 32."""
    bits = np.random.default_rng(seed).integers(0, 2, (n, 2, 7, n_channels), dtype=np.uint64)
    padded = np.pad(bits, [(0, 0)] * 3 + [(0, -n_channels % 32)]).reshape(n, 2, 7, -1, 32)
    words = (padded << np.arange(32, dtype=np.uint64)).sum(axis=-1).astype(np.uint32)
    expected = pairwise(bits, lambda a, b: np.mean(a != b))
    np.testing.assert_allclose(distances.hamming(words, n_channels), expected, rtol=1e-5)


def recorded(name, task, timesteps):
    """The descriptor of a rollout given as (observation, command, where) of each timestep."""
    recorder = distances.DISTANCES[name].recorder
    summary, rows = recorder.start(task), []
    for observation, command, where in timesteps:
        state = SimpleNamespace(observation=jnp.array(observation), where=where)
        summary, row = recorder.update(task, None, summary, Timestep(state, jnp.array(command)))
        rows.append(row)
    return recorder.finish(task, None, summary, jax.tree.map(lambda *rows: jnp.stack(rows), *rows), state)


def test_each_of_forty_sensors_counts_in_the_hamming_distance():
    task = SimpleNamespace(sensors=range(40), effectors=range(3))
    rest = np.zeros(43)
    descriptors = [recorded("hamming", task, [(rest[:40], rest[40:], 0)])]
    for channel in range(43):
        on = np.eye(43)[channel]
        descriptors.append(recorded("hamming", task, [(on[:40], on[40:], 0)]))
    diversity = distances.DISTANCES["hamming"].metric(task, np.stack(descriptors)[:, None])
    # Each of the 43 differs by one bit from rest, and by two from the other 42.
    np.testing.assert_allclose(diversity[0], 43 / 43 / 44, rtol=1e-5)
    np.testing.assert_allclose(diversity[1:], (1 + 42 * 2) / 43 / 44, rtol=1e-5)


def test_cells_may_be_any_number_of_31_bits():
    cells = [0, 40_000, 2_000_000_000]
    task = SimpleNamespace(trajectory_period=1, position=lambda domain, state: jnp.int32(state.where))
    paths = [
        recorded("trajectory", task, [((), (), cell) for cell in path]) for path in itertools.product(cells, cells)
    ]
    assert paths[-1].tolist() == [2_000_000_000] * 2
    diversity = distances.DISTANCES["trajectory"].metric(task, np.stack(paths)[:, None])
    np.testing.assert_allclose(diversity, (4 * 1 + 4 * 2) / 9 / 2, rtol=1e-6)  # four differ in one cell, four in both


def test_entropy():
    counts = np.random.default_rng(0).integers(0, 50, (6, 2, 16, 9))

    def entropies(individual):
        share = individual.sum(axis=0) / individual.sum(axis=(0, 2))[:, None]
        return np.array([-sum(p * np.log(p) for p in row if p > 0) / np.log(9) for row in share])

    expected = pairwise([entropies(c) for c in counts], lambda a, b: np.linalg.norm(a - b))
    np.testing.assert_allclose(distances.entropy(counts), expected, rtol=1e-4)


def test_entropy_of_one_value_is_zero_and_of_all_alike_is_one():
    constant, uniform = np.zeros((1, 1, 2, 9), int), np.full((1, 1, 2, 9), 5)
    constant[..., 3] = 10
    both = np.asarray(distances.entropy(np.concatenate([constant, uniform])))
    np.testing.assert_allclose(both, np.sqrt(2) / 2, rtol=1e-5)


def test_adhoc():
    outcomes = np.random.default_rng(0).random((7, 2, 8)).astype(np.float32)
    expected = pairwise(outcomes, lambda a, b: np.linalg.norm(a - b))
    np.testing.assert_allclose(distances.adhoc(outcomes), expected, rtol=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_trajectory(seed):
    random = np.random.default_rng(seed)
    cells = random.integers(0, 4, (5, 2, 9)).astype(np.int32)
    for individual, test in itertools.product(range(5), range(2)):
        cells[individual, test, random.integers(1, 10) :] = -1

    def distance(a, b):
        return sum(edit_distance([c for c in x if c >= 0], [c for c in y if c >= 0]) for x, y in zip(a, b, strict=True))

    expected = pairwise(cells, distance) / (2 * 9)
    np.testing.assert_allclose(distances.trajectory(cells), expected, rtol=1e-6)
