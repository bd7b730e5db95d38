"""Behavioural diversities against pairwise brute force."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qboot.neuroevolution import diversity


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
@given(st.integers(0, 10_000), st.integers(1, 9))
def test_hamming(seed, n):
    words = np.random.default_rng(seed).integers(0, 2**16, (n, 2, 7), dtype=np.uint16)
    expected = pairwise(
        words,
        lambda a, b: np.mean([bin(int(x) ^ int(y)).count("1") for x, y in zip(a.flat, b.flat, strict=True)]) / 16,
    )
    np.testing.assert_allclose(diversity.hamming(words), expected, rtol=1e-5)


def test_entropy():
    counts = np.random.default_rng(0).integers(0, 50, (6, 2, 16, 9))

    def entropies(individual):
        share = individual.sum(axis=0) / individual.sum(axis=(0, 2))[:, None]
        return np.array([-sum(p * np.log(p) for p in row if p > 0) / np.log(9) for row in share])

    expected = pairwise([entropies(c) for c in counts], lambda a, b: np.linalg.norm(a - b))
    np.testing.assert_allclose(diversity.entropy(counts), expected, rtol=1e-4)


def test_entropy_of_one_value_is_zero_and_of_all_alike_is_one():
    constant, uniform = np.zeros((1, 1, 2, 9), int), np.full((1, 1, 2, 9), 5)
    constant[..., 3] = 10
    both = np.asarray(diversity.entropy(np.concatenate([constant, uniform])))
    np.testing.assert_allclose(both, np.sqrt(2) / 2, rtol=1e-5)


def test_adhoc():
    outcomes = np.random.default_rng(0).random((7, 2, 8)).astype(np.float32)
    expected = pairwise(outcomes, lambda a, b: np.linalg.norm(a - b))
    np.testing.assert_allclose(diversity.adhoc(outcomes), expected, rtol=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_trajectory(seed):
    random = np.random.default_rng(seed)
    cells = random.integers(0, 4, (5, 2, 9)).astype(np.int16)
    for individual, test in itertools.product(range(5), range(2)):
        cells[individual, test, random.integers(1, 10) :] = -1

    def distance(a, b):
        return sum(edit_distance([c for c in x if c >= 0], [c for c in y if c >= 0]) for x, y in zip(a, b, strict=True))

    expected = pairwise(cells, distance) / (2 * 9)
    np.testing.assert_allclose(diversity.trajectory(cells), expected, rtol=1e-6)
