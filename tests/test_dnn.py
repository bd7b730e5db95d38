"""Networks against a node-by-node oracle, and properties of the mutation operators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qboot.neuroevolution import dnn, variation
from qboot.neuroevolution.dnn import DnnSettings, Genome
from qboot.neuroevolution.variation import MutationRates

SMALL = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=4, max_connections=12)
SMALL_FEED_FORWARD = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=4, max_connections=12, feed_forward=True)
OFTEN = MutationRates(0.5, 0.6, 0.6, 0.4, 0.6, 0.3)
# As they are used: each compiled as one.
random_genome = jax.jit(dnn.random_genome, static_argnums=1)
mutate = jax.jit(variation.mutate, static_argnums=(2, 3))
add_connection, add_neuron, remove_neuron, rewire = (
    jax.jit(operator, static_argnums=2)
    for operator in (variation.add_connection, variation.add_neuron, variation.remove_neuron, variation.rewire)
)


def evolved(seed, network, n_mutations=25):
    """A genome after many mutations."""
    genome = random_genome(jax.random.key(seed), network)
    for i in range(n_mutations):
        genome, _ = mutate(jax.random.fold_in(jax.random.key(seed + 1000), i), genome, network, OFTEN)
    return genome


def oracle_step(genome, network, activities, inputs):
    """One synchronous step, connection by connection."""
    value = np.concatenate([inputs, activities]).astype(np.float64)
    drive = -5.0 * np.asarray(genome.biases, np.float64)
    for source, target, weight, connected in zip(*(np.asarray(leaf) for leaf in genome[:4]), strict=True):
        if connected:
            drive[target - network.n_inputs] += weight * value[source]
    return 1 / (1 + np.exp(-drive))


@pytest.mark.parametrize("seed", range(5))
def test_a_step_is_that_of_the_oracle(seed):
    genome = evolved(seed, SMALL)
    network = dnn.express(genome, SMALL)
    random = np.random.default_rng(seed)
    activities, inputs = random.random(SMALL.n_computing), random.random(SMALL.n_inputs)
    ours = dnn.step(network, jnp.float32(activities), jnp.float32(inputs))
    exists = np.concatenate([np.ones(SMALL.n_outputs, bool), genome.hidden])
    expected = oracle_step(genome, SMALL, activities * exists, inputs)
    # Missing neurons are read by no one: they may have any activity.
    ours_without = dnn.step(network, jnp.float32(activities * exists), jnp.float32(inputs))
    np.testing.assert_allclose(ours_without[exists], expected[exists], atol=1e-5)
    np.testing.assert_allclose(ours[exists], ours_without[exists], atol=1e-6)


def test_padding_does_not_matter():
    genome = evolved(3, SMALL)
    roomy = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=9, max_connections=30)

    def padded(leaf, size):
        return jnp.concatenate([leaf, jnp.zeros(size - len(leaf), leaf.dtype)])

    larger = Genome(
        *(padded(leaf, roomy.max_connections) for leaf in genome[:4]),
        biases=padded(genome.biases, roomy.n_computing),
        hidden=padded(genome.hidden, roomy.max_hidden),
    )
    small, large = dnn.express(genome, SMALL), dnn.express(larger, roomy)
    a, b = dnn.rest(small), dnn.rest(large)
    for t in range(20):
        inputs = jax.random.uniform(jax.random.key(t), (3,))
        a, b = dnn.step(small, a, inputs), dnn.step(large, b, inputs)
        np.testing.assert_allclose(a[:2], b[:2], atol=1e-6)


def test_the_first_generation_does_not_depend_on_the_room_for_growth():
    small, large = (
        random_genome(jax.random.key(0), DnnSettings(max_hidden=h, max_connections=c)) for h, c in ((20, 75), (40, 90))
    )
    np.testing.assert_array_equal(small.weights, large.weights[:75])
    np.testing.assert_array_equal(small.biases[:3], large.biases[:3])
    assert int(small.connected.sum()) == 39 and not small.hidden.any()


@pytest.mark.parametrize("network", [SMALL, SMALL_FEED_FORWARD])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_mutated_genomes_are_valid(network, seed):
    genome = evolved(seed, network, 12)
    exists = np.concatenate([np.ones(network.n_inputs + network.n_outputs, bool), genome.hidden])
    pairs = [
        (int(source), int(target))
        for source, target, connected in zip(genome.sources, genome.targets, genome.connected, strict=True)
        if connected
    ]
    assert len(pairs) == len(set(pairs)), "a duplicate connection"
    assert all(exists[source] and exists[target] for source, target in pairs)
    assert all(target >= network.n_inputs for _, target in pairs)
    assert np.abs(genome.weights).max() <= 5 and np.abs(genome.biases).max() <= 5
    if network.feed_forward:
        reached = np.zeros((network.n_neurons, network.n_neurons), bool)
        for source, target in pairs:
            reached[source, target] = True
        paths = reached.copy()
        for _ in range(network.n_neurons):
            paths = paths | ((paths.astype(int) @ reached.astype(int)) > 0)
        assert not np.diag(paths).any(), "a cycle"


def test_splitting_a_connection_keeps_its_weight_on_both_halves():
    before = random_genome(jax.random.key(0), SMALL)
    after, refused = add_neuron(jax.random.key(1), before, SMALL)
    assert not refused and int(after.hidden.sum()) == 1
    assert int(after.connected.sum()) == int(before.connected.sum()) + 1
    neuron = SMALL.n_inputs + SMALL.n_outputs
    into = np.flatnonzero(np.asarray(after.connected & (after.targets == neuron)))
    out = np.flatnonzero(np.asarray(after.connected & (after.sources == neuron)))
    assert len(into) == len(out) == 1
    split = np.flatnonzero(
        np.asarray(
            (before.sources == after.sources[into[0]]) & (before.targets == after.targets[out[0]]) & before.connected
        )
    )
    assert after.weights[into[0]] == after.weights[out[0]] == before.weights[split[0]]


def test_removing_a_neuron_removes_its_connections():
    with_neuron, _ = add_neuron(jax.random.key(1), random_genome(jax.random.key(0), SMALL), SMALL)
    without, _ = remove_neuron(jax.random.key(2), with_neuron, SMALL)
    assert not without.hidden.any() and int(without.connected.sum()) == 5
    untouched, _ = remove_neuron(jax.random.key(3), without, SMALL)
    np.testing.assert_array_equal(untouched.connected, without.connected)


def test_a_full_genome_refuses_growth_and_says_so():
    full = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=1, max_connections=7)
    genome = random_genome(jax.random.key(0), full)
    genome, refused = add_connection(jax.random.key(1), genome, full)
    assert not refused and genome.connected.all()
    _, refused = add_connection(jax.random.key(2), genome, full)
    assert refused
    _, refused = add_neuron(jax.random.key(3), genome, full)
    assert refused


def test_rewiring_changes_one_end():
    before = random_genome(jax.random.key(0), DnnSettings(n_inputs=3, n_outputs=2, max_hidden=4, max_connections=8))
    network = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=4, max_connections=8)
    for seed in range(20):
        after, _ = rewire(jax.random.key(seed), before, network)
        changed = np.asarray((before.sources != after.sources) | (before.targets != after.targets))
        assert changed.sum() <= 1
        np.testing.assert_array_equal(before.weights, after.weights)


def test_polynomial_mutation_has_its_published_distribution():
    # For a value far from both bounds, |change| / range has the cumulative distribution 1 - (1 - d)^(eta + 1).
    polynomial = jax.jit(variation.polynomial, static_argnums=(2, 3))
    draws = polynomial(jax.random.key(0), jnp.zeros(40_000), 5.0, 15.0)
    for share in (0.02, 0.05, 0.1):
        expected = 1 - (1 - share) ** 16
        assert abs(float(jnp.mean(jnp.abs(draws) / 10 <= share)) - expected) < 0.01
    edge = polynomial(jax.random.key(1), jnp.full(1000, 5.0), 5.0, 15.0)
    assert float(edge.max()) <= 5.0 and float(edge.min()) >= -5.0


def test_rates_are_met():
    genome = random_genome(jax.random.key(0), DnnSettings())
    keys = jax.random.split(jax.random.key(1), 3000)
    mutants = jax.jit(jax.vmap(lambda key: variation.mutate(key, genome, DnnSettings(), MutationRates())[0]))(keys)
    assert abs(float(mutants.hidden.any(axis=1).mean()) - 0.088 * (1 - 0.098)) < 0.02
    changed = np.asarray(mutants.biases[:, :3] != genome.biases[:3])
    assert abs(changed.mean() - 0.1) < 0.02


@pytest.mark.parametrize("operator", [add_neuron, remove_neuron])
def test_without_room_for_hidden_neurons_none_comes_or_goes(operator):
    network = DnnSettings(n_inputs=3, n_outputs=2, max_hidden=0, max_connections=12)
    before = random_genome(jax.random.key(0), network)
    after, refused = operator(jax.random.key(1), before, network)
    jax.tree.map(np.testing.assert_array_equal, before, after)
    assert bool(refused) == (operator is add_neuron)
    mutant, _ = mutate(jax.random.key(2), before, network, OFTEN)
    assert dnn.express(mutant, network).weights.shape == (2, 5)


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        (DnnSettings, {"max_connections": 5}, "max_connections is 5"),
        (DnnSettings, {"n_inputs": 0}, "n_inputs is 0: it must be at least 1"),
        (DnnSettings, {"n_outputs": -1}, "n_outputs is -1"),
        (DnnSettings, {"max_hidden": -1}, "max_hidden is -1"),
        (DnnSettings, {"weight_limit": 0.0}, "weight_limit is 0.0"),
        (DnnSettings, {"weight_limit": np.nan}, "weight_limit is nan"),
        (DnnSettings, {"weight_limit": np.inf}, "weight_limit is inf"),
        (MutationRates, {"rewire": 1.5}, r"rewire is 1\.5"),
        (MutationRates, {"weight": np.nan}, "weight is nan"),
        (MutationRates, {"polynomial_index": -1.0}, "polynomial_index is -1.0"),
        (MutationRates, {"polynomial_index": np.inf}, "polynomial_index is inf"),
    ],
)
def test_bad_settings_are_named(kind, change, words):
    with pytest.raises(ValueError, match=words):
        kind(**change)
