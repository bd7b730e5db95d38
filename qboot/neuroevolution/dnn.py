"""DNN, the direct encoding of neural networks (paper, section III-B3): padded genotype and synchronous network.

Neurons are numbered inputs first, then outputs, then hidden neurons, so that a network keeps its numbers whatever the
room for hidden neurons. Shape letters: S inputs, E outputs, H hidden neurons at most, C connections at most,
K = E + H neurons that compute, N = S + K neurons in all.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np

BIAS_GAIN = 5.0  # a bias acts five-fold, as in the authors' program

LEAST_ROOM = 4  # less room than this for hidden neurons saves nothing


@dataclass(frozen=True)
class DnnSettings:
    """What all networks of a run share (appendix B). Raises `ValueError` when a value makes no network."""

    n_inputs: int = 13
    """S: input neurons, one per sensor, >= 1."""
    n_outputs: int = 3
    """E: output neurons, one per effector, >= 1."""
    max_hidden: int = 20
    """H: hidden neurons at most, >= 0."""
    max_connections: int = 75
    """C: connections at most, >= S E."""
    weight_limit: float = 5.0
    """Weights and biases lie in [-weight_limit, weight_limit], > 0."""
    feed_forward: bool = False
    """Whether mutation keeps networks free of cycles."""

    def __post_init__(self):
        """Refuse what makes no network, or has no room for the first generation."""
        for name, least in (("n_inputs", 1), ("n_outputs", 1), ("max_hidden", 0)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least {least}")
        if not 0 < self.weight_limit < math.inf:
            raise ValueError(f"weight_limit is {self.weight_limit}: it must be finite and above 0")
        if not self.max_connections >= self.n_inputs * self.n_outputs:
            raise ValueError(
                f"max_connections is {self.max_connections}, but the first generation connects each of "
                f"{self.n_inputs} inputs to each of {self.n_outputs} outputs: at least {self.n_inputs * self.n_outputs}"
            )

    @property
    def n_computing(self) -> int:
        """K, outputs and hidden neurons."""
        return self.n_outputs + self.max_hidden

    @property
    def n_neurons(self) -> int:
        """N, all neurons."""
        return self.n_inputs + self.n_computing


class Genome(NamedTuple):
    """A network as lists of connections and neurons; what the masks leave out is padding without effect."""

    sources: jax.Array  # (C,) int32 neuron numbers
    targets: jax.Array  # (C,) int32 neuron numbers, never an input
    weights: jax.Array  # (C,) float32
    connected: jax.Array  # (C,) bool, which connections exist
    biases: jax.Array  # (K,) float32, outputs first
    hidden: jax.Array  # (H,) bool, which hidden neurons exist


class Network(NamedTuple):
    """A genome expressed for evaluation."""

    weights: jax.Array  # (K, N) dense, 0 where there is no connection
    biases: jax.Array  # (K,)


def random_genome(key: jax.Array, settings: DnnSettings) -> Genome:
    """A network of the first generation: every input to every output, no hidden neuron, uniform weights and biases."""
    n_first = settings.n_inputs * settings.n_outputs
    index = jnp.arange(settings.max_connections)
    connected = index < n_first
    key_weights, key_biases = jax.random.split(key)
    # Drawn one by one, so that a network does not depend on the room left for its growth.
    draw = jax.vmap(lambda key, i: jax.random.uniform(jax.random.fold_in(key, i), minval=-1.0), in_axes=(None, 0))
    limit = settings.weight_limit
    return Genome(
        sources=jnp.where(connected, index % settings.n_inputs, 0).astype(jnp.int32),
        targets=jnp.where(connected, settings.n_inputs + index // settings.n_inputs, settings.n_inputs).astype(
            jnp.int32
        ),
        weights=jnp.where(connected, limit * draw(key_weights, index), 0.0),
        connected=connected,
        biases=jnp.where(
            jnp.arange(settings.n_computing) < settings.n_outputs,
            limit * draw(key_biases, jnp.arange(settings.n_computing)),
            0.0,
        ),
        hidden=jnp.zeros(settings.max_hidden, bool),
    )


def express(genome: Genome, settings: DnnSettings) -> Network:
    """The dense network of a genome, built once per evaluation."""
    chex.assert_shape([genome.sources, genome.targets, genome.weights, genome.connected], (settings.max_connections,))
    chex.assert_shape([genome.biases, genome.hidden], [(settings.n_computing,), (settings.max_hidden,)])
    rows = jnp.where(genome.connected, genome.targets - settings.n_inputs, settings.n_computing)
    weights = jnp.zeros((settings.n_computing, settings.n_neurons))
    return Network(weights.at[rows, genome.sources].add(genome.weights, mode="drop"), genome.biases)


def least_room(genomes: Genome, settings: DnnSettings) -> int:
    """Room for hidden neurons that B networks (leading axis) fit into: 4, 8, 16, ..., or all that there is.

    Evolved networks have few hidden neurons, and the cost of a step grows with the room for them.
    """
    hidden = np.asarray(genomes.hidden)
    needed = np.max(hidden * np.arange(1, settings.max_hidden + 1), initial=0)
    room = LEAST_ROOM
    while room < needed:
        room *= 2
    return min(room, settings.max_hidden)


def cropped(genomes: Genome, settings: DnnSettings) -> Genome:
    """Genomes (leading axis) without the room for hidden neurons that `settings` do not have; they must fit."""
    n_computing, max_hidden = settings.n_computing, settings.max_hidden
    return genomes._replace(biases=genomes.biases[:, :n_computing], hidden=genomes.hidden[:, :max_hidden])


def rest(network: Network) -> jax.Array:
    """Activities (K,) before the first step: all 0."""
    return jnp.zeros_like(network.biases)


def step(network: Network, activities: jax.Array, inputs: jax.Array) -> jax.Array:
    """All neurons at once, from the inputs (S,) and the activities (K,) of the step before; the first E are outputs.

    A connection between computing neurons therefore takes one step, in recurrent and feed-forward networks alike.
    """
    n_computing, n_neurons = network.weights.shape
    chex.assert_shape([activities, inputs], [(n_computing,), (n_neurons - n_computing,)])
    drive = network.weights @ jnp.concatenate([inputs, activities])
    return jax.nn.sigmoid(drive - BIAS_GAIN * network.biases)
