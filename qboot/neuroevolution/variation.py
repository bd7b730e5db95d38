"""The mutation operators of DNN at the paper's rates (section III-B3, appendix B). There is no crossover.

Every operator takes and returns one genome and says how many mutations it had to refuse for want of room, so that
the caps of appendix B never act unseen.
"""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from qboot.neuroevolution.dnn import DnnSettings, Genome


@dataclass(frozen=True)
class MutationRates:
    """Probabilities per child (appendix B). Raises `ValueError` when a value lies outside its range."""

    weight: float = 0.1
    """Each weight and bias: polynomial mutation."""
    rewire: float = 0.2
    """A connection gets a new source or target."""
    add_connection: float = 0.133
    """A connection between two random neurons."""
    remove_connection: float = 0.147
    """A random connection."""
    add_neuron: float = 0.088
    """A neuron in the middle of a random connection."""
    remove_neuron: float = 0.098
    """A random hidden neuron with its connections."""
    polynomial_index: float = 15.0
    """eta_m, >= 0: the larger, the smaller the changes of weights."""

    def __post_init__(self):
        """Refuse values outside their range."""
        for name in (
            "weight",
            "rewire",
            "add_connection",
            "remove_connection",
            "add_neuron",
            "remove_neuron",
        ):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"mutation rate {name} is {getattr(self, name)}: it must lie in [0, 1]")
        if not 0.0 <= self.polynomial_index < math.inf:
            raise ValueError(f"polynomial_index is {self.polynomial_index}: it must be finite and at least 0")


def mutate(key: jax.Array, genome: Genome, settings: DnnSettings, rates: MutationRates) -> tuple[Genome, jax.Array]:
    """A mutated copy of a genome and the number () int32 of mutations refused for want of room."""
    keys = jax.random.split(key, 11)
    genome = mutate_weights(keys[0], genome, settings, rates)
    operators = (
        (rates.rewire, rewire),
        (rates.add_connection, add_connection),
        (rates.remove_connection, remove_connection),
        (rates.add_neuron, add_neuron),
        (rates.remove_neuron, remove_neuron),
    )
    # All at once: each call of a random number generator takes a fifth of a second to compile.
    happens = jax.vmap(jax.random.bernoulli)(keys[1::2], jnp.array([rate for rate, _ in operators]))
    n_refused = jnp.int32(0)
    for i, (_, operator) in enumerate(operators):
        changed, refused = operator(keys[2 * i + 2], genome, settings)
        genome = jax.tree.map(lambda new, old, i=i: jnp.where(happens[i], new, old), changed, genome)
        n_refused += (happens[i] & refused).astype(jnp.int32)
    return genome, n_refused


def polynomial(key: jax.Array, values: jax.Array, limit: float, index: float) -> jax.Array:
    """Deb's bounded polynomial mutation of `values` (n,) in [-limit, limit] with distribution index `index`."""
    draw = jax.random.uniform(key, values.shape)
    to_low, to_high = (values + limit) / (2 * limit), (limit - values) / (2 * limit)
    power = 1.0 / (index + 1.0)
    down = (2 * draw + (1 - 2 * draw) * (1 - to_low) ** (index + 1)) ** power - 1.0
    up = 1.0 - (2 * (1 - draw) + 2 * (draw - 0.5) * (1 - to_high) ** (index + 1)) ** power
    return jnp.clip(values + 2 * limit * jnp.where(draw < 0.5, down, up), -limit, limit)


def mutate_weights(key: jax.Array, genome: Genome, settings: DnnSettings, rates: MutationRates) -> Genome:
    """Polynomial mutation of each weight and bias with probability `rates.weight`."""

    def change(key: jax.Array, values: jax.Array, exists: jax.Array) -> jax.Array:
        key_which, key_how = jax.random.split(key)
        chosen = jax.random.bernoulli(key_which, rates.weight, values.shape) & exists
        mutated = polynomial(key_how, values, settings.weight_limit, rates.polynomial_index)
        return jnp.where(chosen, mutated, values)

    key_weights, key_biases = jax.random.split(key)
    return genome._replace(
        weights=change(key_weights, genome.weights, genome.connected),
        biases=change(key_biases, genome.biases, _existing(genome, settings)[settings.n_inputs :]),
    )


def add_connection(key: jax.Array, genome: Genome, settings: DnnSettings) -> tuple[Genome, jax.Array]:
    """Connect two random neurons that are not connected yet, with a random weight."""
    key_where, key_weight = jax.random.split(key)
    allowed = allowed_connections(genome, settings)
    index, possible = _choose(key_where, allowed.reshape(-1))
    room = jnp.any(~genome.connected)
    slot = jnp.where(possible & room, jnp.argmin(genome.connected), settings.max_connections)
    limit = settings.weight_limit
    weight = jax.random.uniform(key_weight, minval=-limit, maxval=limit)
    source, target = index % settings.n_neurons, index // settings.n_neurons + settings.n_inputs
    return _put(genome, slot, source, target, weight), possible & ~room


def remove_connection(key: jax.Array, genome: Genome, settings: DnnSettings) -> tuple[Genome, jax.Array]:
    """Remove a random connection."""
    del settings
    slot, _ = _choose(key, genome.connected)
    return _clear(genome, jnp.arange(len(genome.connected)) == slot), jnp.array(False)


def rewire(key: jax.Array, genome: Genome, settings: DnnSettings) -> tuple[Genome, jax.Array]:
    """Give a random connection a new source or a new target, never making a duplicate."""
    key_which, key_end, key_where = jax.random.split(key, 3)
    slot, any_connection = _choose(key_which, genome.connected)
    source, target = genome.sources[slot], genome.targets[slot]
    without = _clear(genome, jnp.arange(len(genome.connected)) == slot)
    rows, columns = jnp.meshgrid(jnp.arange(settings.n_computing), jnp.arange(settings.n_neurons), indexing="ij")
    same_target, same_source = rows == target - settings.n_inputs, columns == source
    end = jnp.where(jax.random.bernoulli(key_end), same_target, same_source) & ~(same_target & same_source)
    index, possible = _choose(key_where, (allowed_connections(without, settings) & end).reshape(-1))
    slot = jnp.where(possible & any_connection, slot, settings.max_connections)
    source, target = index % settings.n_neurons, index // settings.n_neurons + settings.n_inputs
    return _put(genome, slot, source, target, genome.weights[slot]), jnp.array(False)


def add_neuron(key: jax.Array, genome: Genome, settings: DnnSettings) -> tuple[Genome, jax.Array]:
    """Split a random connection: both halves take the old weight, the new neuron a random bias."""
    if not settings.max_hidden:
        return genome, jnp.any(genome.connected)
    key_which, key_bias = jax.random.split(key)
    slot, possible = _choose(key_which, genome.connected)
    room = jnp.any(~genome.hidden) & jnp.any(~genome.connected)
    happens = possible & room
    place = jnp.argmin(genome.hidden)
    neuron = settings.n_inputs + settings.n_outputs + place
    source, target, weight = genome.sources[slot], genome.targets[slot], genome.weights[slot]
    second = jnp.where(happens, jnp.argmin(genome.connected), settings.max_connections)
    slot = jnp.where(happens, slot, settings.max_connections)
    place = jnp.where(happens, place, settings.max_hidden)
    limit = settings.weight_limit
    bias = jax.random.uniform(key_bias, minval=-limit, maxval=limit)
    bias_place = jnp.where(happens, settings.n_outputs + place, settings.n_computing)
    genome = genome._replace(
        hidden=genome.hidden.at[place].set(True, mode="drop"),
        biases=genome.biases.at[bias_place].set(bias, mode="drop"),
    )
    genome = _put(genome, slot, source, neuron, weight)
    return _put(genome, second, neuron, target, weight), possible & ~room


def remove_neuron(key: jax.Array, genome: Genome, settings: DnnSettings) -> tuple[Genome, jax.Array]:
    """Remove a random hidden neuron with all its connections."""
    if not settings.max_hidden:
        return genome, jnp.array(False)
    place, possible = _choose(key, genome.hidden)
    neuron = settings.n_inputs + settings.n_outputs + place
    index = jnp.arange(settings.n_computing)
    genome = genome._replace(
        hidden=genome.hidden & ~(possible & (jnp.arange(settings.max_hidden) == place)),
        biases=jnp.where(possible & (index == settings.n_outputs + place), 0.0, genome.biases),
    )
    touching = (genome.sources == neuron) | (genome.targets == neuron)
    return _clear(genome, possible & touching), jnp.array(False)


def allowed_connections(genome: Genome, settings: DnnSettings) -> jax.Array:
    """(K, N) bool: pairs of existing neurons not connected yet and, in feed-forward networks, closing no cycle."""
    exists = _existing(genome, settings)
    rows = jnp.where(genome.connected, genome.targets - settings.n_inputs, settings.n_computing)
    connected = jnp.zeros((settings.n_computing, settings.n_neurons), bool)
    connected = connected.at[rows, genome.sources].set(True, mode="drop")
    allowed = exists[settings.n_inputs :, None] & exists[None, :] & ~connected
    if not settings.feed_forward:
        return allowed
    # reaches[a, b]: a signal of b arrives at a. A connection from source to target closes a cycle when the target
    # reaches the source. Squaring doubles the length of the paths that are known.
    reaches = connected[:, settings.n_inputs :] | jnp.eye(settings.n_computing, dtype=bool)
    for _ in range((settings.n_computing - 1).bit_length()):
        reaches = (reaches.astype(jnp.float32) @ reaches.astype(jnp.float32)) > 0
    from_inputs = jnp.zeros((settings.n_computing, settings.n_inputs), bool)
    return allowed & ~jnp.concatenate([from_inputs, reaches.T], axis=1)


def _existing(genome: Genome, settings: DnnSettings) -> jax.Array:
    """(N,) bool: inputs and outputs always exist."""
    return jnp.concatenate([jnp.ones(settings.n_inputs + settings.n_outputs, bool), genome.hidden])


def _choose(key: jax.Array, mask: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A uniformly random True index of `mask` (n,), and whether there is one."""
    return jax.random.categorical(key, jnp.where(mask, 0.0, -jnp.inf)), jnp.any(mask)


def _put(genome: Genome, slot: jax.Array, source: jax.Array, target: jax.Array, weight: jax.Array) -> Genome:
    """The genome with a connection written into `slot`; a slot past the end writes nothing."""
    return genome._replace(
        sources=genome.sources.at[slot].set(source.astype(jnp.int32), mode="drop"),
        targets=genome.targets.at[slot].set(target.astype(jnp.int32), mode="drop"),
        weights=genome.weights.at[slot].set(weight, mode="drop"),
        connected=genome.connected.at[slot].set(True, mode="drop"),
    )


def _clear(genome: Genome, slots: jax.Array) -> Genome:
    """The genome without the connections in `slots` (C,) bool."""
    return genome._replace(connected=genome.connected & ~slots, weights=jnp.where(slots, 0.0, genome.weights))
