"""NSGA-II against a brute-force oracle written from the definitions."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from qboot.neuroevolution import nsga2

# Few distinct values, so that duplicates and equal objectives are the rule; few shapes, as each is compiled.
OBJECTIVES = st.sampled_from([(1, 2), (5, 1), (12, 2), (14, 3)]).flatmap(
    lambda shape: arrays(np.float32, shape, elements=st.sampled_from([0, 1, 2, 3.5]))
)
select = jax.jit(nsga2.select, static_argnums=1)
ranks_of = jax.jit(nsga2.non_dominated_rank)
crowding_of = jax.jit(nsga2.crowding_distance)
tournament = jax.jit(nsga2.tournament, static_argnums=3)


def oracle_ranks(objectives):
    """Peel fronts off by comparing every pair."""
    left, ranks, rank = set(range(len(objectives))), np.zeros(len(objectives), int), 0
    while left:
        front = {
            i
            for i in left
            if not any((objectives[j] >= objectives[i]).all() and (objectives[j] > objectives[i]).any() for j in left)
        }
        for i in front:
            ranks[i] = rank
        left -= front
        rank += 1
    return ranks


def oracle_crowding(front):
    """Crowding within one front without ties in any objective."""
    total = np.zeros(len(front))
    for values in front.T:
        order = np.argsort(values)
        total[order[[0, -1]]] = np.inf
        for before, here, after in zip(order, order[1:], order[2:], strict=False):
            total[here] += (values[after] - values[before]) / (values[order[-1]] - values[order[0]])
    return total / front.shape[1]


@settings(max_examples=60, deadline=None)
@given(OBJECTIVES)
def test_ranks_are_those_of_the_oracle(objectives):
    assert np.array_equal(ranks_of(objectives), oracle_ranks(objectives))


@settings(max_examples=40, deadline=None)
@given(OBJECTIVES, st.sampled_from([1, 4, 8, 14]))
def test_survivors_come_from_the_first_fronts(objectives, n):
    n = min(n, len(objectives))
    chosen = np.asarray(select(objectives, n))
    ranks = oracle_ranks(objectives)
    assert len(set(chosen.tolist())) == n
    assert sorted(ranks[chosen]) == sorted(ranks)[:n]


@pytest.mark.parametrize(
    ("objectives", "expected"),
    [
        ([[1.0, 1.0]], [0]),
        ([[2.0, 2.0]] * 4, [0, 0, 0, 0]),
        ([[3, 0], [2, 1], [1, 2], [0, 3]], [0, 0, 0, 0]),
        ([[0.0], [1.0], [2.0]], [2, 1, 0]),
        ([[1, 1], [0, 0], [1, 0]], [0, 2, 1]),
    ],
)
def test_ranks_by_hand(objectives, expected):
    assert ranks_of(np.array(objectives, float)).tolist() == expected


def test_crowding_is_that_of_the_oracle_in_each_front():
    random = np.random.default_rng(0)
    objectives = random.random((60, 2)).astype(np.float32)
    ranks = oracle_ranks(objectives)
    crowding = np.asarray(crowding_of(objectives, ranks))
    for rank in set(ranks):
        expected = oracle_crowding(objectives[ranks == rank])
        np.testing.assert_allclose(crowding[ranks == rank], expected, rtol=1e-5)


def test_crowding_by_hand():
    # One front; the ends are infinite, the middle ones have sides 3/4 + 3/4 and 3/4 + 3/4, halved.
    objectives = np.array([[0, 4], [1, 3], [3, 1], [4, 0]], float)
    assert crowding_of(objectives, np.zeros(4, int)).tolist() == [np.inf, 0.75, 0.75, np.inf]


def test_crowding_does_not_depend_on_order_or_scale():
    random = np.random.default_rng(1)
    objectives = random.random((30, 2)).astype(np.float32)
    ranks = np.asarray(ranks_of(objectives))
    crowding = np.asarray(crowding_of(objectives, ranks))
    order = random.permutation(30)
    np.testing.assert_allclose(crowding_of(objectives[order], ranks[order]), crowding[order], rtol=1e-6)
    np.testing.assert_allclose(crowding_of(objectives * 8 + 2, ranks), crowding, rtol=1e-4)


def test_the_last_front_is_cut_by_crowding():
    objectives = np.array([[5, 5], [0, 4], [1, 3], [1.1, 2.9], [4, 0]], float)
    assert set(np.asarray(select(objectives, 4)).tolist()) == {0, 1, 3, 4}


def test_tournament_prefers_rank_then_crowding_then_tosses_a_coin():
    ranks, crowding = np.array([1, 0, 0]), np.array([9.0, 1.0, 2.0])
    winners = np.asarray(tournament(jax.random.key(0), ranks, crowding, 6000))
    share = np.bincount(winners, minlength=3) / 6000
    # The best of two drawn with replacement: worst, middle, best win 1/9, 3/9, 5/9 of the draws.
    np.testing.assert_allclose(share, [1 / 9, 3 / 9, 5 / 9], atol=0.03)
    ties = np.asarray(tournament(jax.random.key(1), np.zeros(2), np.ones(2), 4000))
    np.testing.assert_allclose(np.mean(ties), 0.5, atol=0.04)


@pytest.mark.parametrize("bad", [np.zeros((0, 2)), np.zeros((3, 0)), np.zeros(4)])
def test_bad_shapes_are_named(bad):
    with pytest.raises(ValueError, match="shape"):
        nsga2.non_dominated_rank(bad)


def test_selecting_too_many_is_refused():
    with pytest.raises(ValueError, match="cannot select 5 of 3"):
        nsga2.select(np.zeros((3, 2)), 5)
