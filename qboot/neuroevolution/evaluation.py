"""Running networks in a task: many controllers, all domains, one compiled loop.

Shape letters: B controllers, n tests (domains x tests per domain), L = B n lanes that run side by side, T steps.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.types import Domain, Task, TaskState
from qboot.neuroevolution import dnn
from qboot.neuroevolution.behaviour import RECORDERS, Recorder
from qboot.neuroevolution.dnn import Genome, Network, Topology

# Steps between two looks at whether any lane still runs.
CHUNK = 250
# Controllers per compiled call on a CPU: their data stays in the cache, and calls spread over the cores.
BLOCK = 16


class Evaluation(NamedTuple):
    """What evaluating B controllers gives."""

    scores: jax.Array  # (B, n) rewards earned in each test, in units of the task's reward
    steps: jax.Array  # (B, n) int32 steps lived
    behaviours: jax.Array  # (B, n, ...) descriptions by the recorder


class Trace(NamedTuple):
    """The sensori-motor flow of B controllers (paper, section IV-A)."""

    observations: jax.Array  # (B, n, T, S)
    commands: jax.Array  # (B, n, T, E), each in response to the observation of the same step
    steps: jax.Array  # (B, n) int32: what comes after the first `steps` steps is no part of the flow


def tests_of(task: Task, domains: Domain) -> tuple[Domain, int]:
    """The domain of each test of an episode, leading axis n, and n."""
    tests = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), task.tests_per_domain, axis=0), domains)
    return tests, len(jax.tree.leaves(tests)[0])


def run(
    task: Task, recorder: Recorder, networks: Network, domains: Domain, keys: jax.Array, n_steps: int
) -> tuple[TaskState, jax.Array, jax.Array, jax.Array | None]:
    """Run L networks, each in its own domain, until `n_steps` or until all are done.

    Args:
        task: the task.
        recorder: what to record at each step.
        networks: leading axis L.
        domains: leading axis L.
        keys: (L,) random keys for the starts.
        n_steps: T, steps at most.

    Returns:
        Final states (L, ...), rewards (L,), steps lived (L,) int32, and records (T, L, ...).
    """
    n_effectors = len(task.effectors)
    chunk = min(CHUNK, n_steps)
    n_chunks = -(-n_steps // chunk)

    def step(carry, t):
        states, activities, rewards, steps = carry
        alive = ~states.done & (t < n_steps)
        # Every lane has its own weights, repeated if need be: a batch of matrix-vector products stays inside the
        # one kernel that the loop compiles to, a product with shared weights does not.
        activities = jax.vmap(dnn.step)(networks, activities, states.observation)
        commands = activities[:, :n_effectors]
        record = jax.vmap(lambda d, s, c: recorder.record(task, d, s, c))(domains, states, commands)
        after = jax.vmap(task.step)(domains, states, commands)
        if n_steps % chunk:  # the last chunk runs over the end
            after = jax.tree.map(lambda a, b: jnp.where(_expand(alive, a), a, b), after, states)
        rewards += jnp.where(alive, after.reward, 0.0)
        return (after, activities, rewards, steps + alive), record

    def run_chunk(carry):
        inner, records, i = carry
        inner, new = jax.lax.scan(step, inner, i * chunk + jnp.arange(chunk))
        records = jax.tree.map(
            lambda all, part: jax.lax.dynamic_update_slice_in_dim(all, part, i * chunk, axis=0), records, new
        )
        return inner, records, i + 1

    states = jax.vmap(task.reset)(keys, domains)
    n_lanes = len(states.done)
    inner = (states, jax.vmap(dnn.rest)(networks), jnp.zeros(n_lanes), jnp.zeros(n_lanes, jnp.int32))
    shapes = jax.eval_shape(step, inner, jnp.int32(0))[1]
    records = jax.tree.map(lambda leaf: jnp.zeros((n_chunks * chunk, *leaf.shape), leaf.dtype), shapes)
    inner, records, _ = jax.lax.while_loop(
        lambda carry: (carry[2] < n_chunks) & ~jnp.all(carry[0][0].done), run_chunk, (inner, records, jnp.int32(0))
    )
    states, _, rewards, steps = inner
    return states, rewards, steps, jax.tree.map(lambda leaf: leaf[:n_steps], records)


def evaluate(
    task: Task, topology: Topology, behaviour: str, genomes: Genome, domains: Domain, keys: jax.Array, n_steps: int
) -> Evaluation:
    """Evaluate B genomes, one episode each: `keys` (B,) decide the starts, `behaviour` names the recorder."""
    recorder = RECORDERS[behaviour]
    lanes = _lanes(task, topology, genomes, domains, keys)
    states, rewards, steps, records = run(task, recorder, *lanes, n_steps)
    behaviours = jax.vmap(
        lambda d, r, n, s: recorder.describe(task, d, r, n, s),
        in_axes=(0, None if records is None else 1, 0, 0),
    )(lanes[1], records, steps, states)
    n_controllers = len(keys)

    def by_controller(leaf: jax.Array) -> jax.Array:
        return leaf.reshape(n_controllers, -1, *leaf.shape[1:])

    return Evaluation(by_controller(rewards / task.reward), by_controller(steps), by_controller(behaviours))


def trace(
    task: Task, topology: Topology, genomes: Genome, domains: Domain, keys: jax.Array, n_steps: int
) -> Trace:
    """Run B genomes again as `evaluate` did and keep all that they sensed and commanded."""
    recorder = Recorder(lambda task, domain, state, command: (state.observation, command), lambda *_: None)
    lanes = _lanes(task, topology, genomes, domains, keys)
    _, _, steps, records = run(task, recorder, *lanes, n_steps)
    n_controllers = len(keys)
    observations, commands = (
        jnp.moveaxis(leaf, 0, 1).reshape(n_controllers, -1, n_steps, leaf.shape[-1]) for leaf in records
    )
    return Trace(observations, commands, steps.reshape(n_controllers, -1))


def in_blocks(function: Callable, workers: int, *batched, block: int = BLOCK):
    """Call a compiled `function` on blocks of the leading axis of `batched`, spread over threads.

    A result does not depend on the number of workers. The last block is filled up with repetitions, so that one
    compiled program serves all.

    Returns:
        The results, as NumPy arrays, joined along the leading axis.
    """
    n = len(jax.tree.leaves(batched)[0])
    block = min(block, n)

    def call(start: int):
        index = np.minimum(np.arange(start, start + block), n - 1)
        return jax.device_get(function(*jax.tree.map(lambda leaf: leaf[index], batched)))

    starts = range(0, n, block)
    if workers == 1:
        results = [call(start) for start in starts]
    else:
        with ThreadPoolExecutor(workers) as pool:
            results = list(pool.map(call, starts))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:n], *results)


def _lanes(task: Task, topology: Topology, genomes: Genome, domains: Domain, keys: jax.Array):
    """Networks, domains and keys of the L = B n lanes, the tests of a controller side by side."""
    tests, n_tests = tests_of(task, domains)
    networks = jax.vmap(lambda genome: dnn.express(genome, topology))(genomes)
    networks = jax.tree.map(lambda leaf: jnp.repeat(leaf, n_tests, axis=0), networks)
    lanes = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(keys),) + (1,) * (leaf.ndim - 1)), tests)
    test_keys = jax.vmap(lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(jnp.arange(n_tests)))(keys)
    return networks, lanes, test_keys.reshape(-1)


def _expand(mask: jax.Array, like: jax.Array) -> jax.Array:
    return mask.reshape(mask.shape + (1,) * (like.ndim - mask.ndim))
