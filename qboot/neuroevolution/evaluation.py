"""Running networks in a task: many controllers, all domains, one compiled loop.

Shape letters: B controllers, n tests (domains x tests per domain), L = B n lanes that run side by side, T steps.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.types import Domain, Task
from qboot.neuroevolution import dnn
from qboot.neuroevolution.behaviour import Moment, Recorder
from qboot.neuroevolution.dnn import Genome, Network, Topology

# Steps between two looks at whether any lane still runs.
CHUNK = 250
# Controllers per compiled call on a CPU: their data stays in the cache, and calls spread over the cores.
BLOCK = 16


class Evaluation(NamedTuple):
    """What evaluating B controllers gives."""

    scores: jax.Array  # (B, n) rewards earned in each test, in units of the task's reward
    steps: jax.Array  # (B, n) int32 steps lived
    descriptions: Any  # (B, n, ...) by the recorder


def tests_of(task: Task, domains: Domain) -> tuple[Domain, int]:
    """The domain of each test of an episode, leading axis n, and n."""
    tests = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), task.tests_per_domain, axis=0), domains)
    return tests, len(jax.tree.leaves(tests)[0])


def run(
    task: Task, recorder: Recorder, networks: Network, domains: Domain, keys: jax.Array
) -> tuple[Any, jax.Array, jax.Array]:
    """Run L networks, each in its own domain, for the task's `max_steps` or until all are done or idle.

    Args:
        task: the task.
        recorder: what to keep of each test.
        networks: leading axis L.
        domains: leading axis L.
        keys: (L,) random keys for the starts.

    Returns:
        Descriptions by the recorder (L, ...), rewards (L,), steps lived (L,) int32.
    """

    def goes_on(states):
        return ~states.done & ~jax.vmap(task.is_idle)(states)

    def step(carry, t):
        states, activities, rewards, steps, records = carry
        alive = goes_on(states) & (t < n_steps)
        # Every lane has its own weights, repeated if need be: a batch of matrix-vector products stays inside the
        # one kernel that the loop compiles to, a product with shared weights does not.
        activities = jax.vmap(dnn.step)(networks, activities, states.observation)
        commands = activities[:, : len(task.effectors)]
        moments = Moment(t, alive, states, commands)
        records = jax.vmap(partial(recorder.update, task), in_axes=(0, 0, Moment(None, 0, 0, 0)))(
            domains, records, moments
        )
        after = jax.vmap(task.step)(domains, states, commands)
        after = jax.tree.map(lambda new, old: jnp.where(_expand(alive, new), new, old), after, states)
        return (after, activities, rewards + jnp.where(alive, after.reward, 0.0), steps + alive, records), None

    def run_chunk(carry):
        inner, i = carry
        return jax.lax.scan(step, inner, i * chunk + jnp.arange(chunk))[0], i + 1

    def any_goes_on(carry):
        (states, *_), i = carry
        return (i < n_chunks) & jnp.any(goes_on(states))

    n_steps = task.max_steps
    chunk = min(CHUNK, n_steps)
    n_chunks = -(-n_steps // chunk)
    n_lanes = len(keys)
    states = jax.vmap(task.reset)(keys, domains)
    records = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n_lanes, *leaf.shape)), recorder.start(task, n_steps))
    inner = (states, jax.vmap(dnn.rest)(networks), jnp.zeros(n_lanes), jnp.zeros(n_lanes, jnp.int32), records)
    states, _, rewards, steps, records = jax.lax.while_loop(any_goes_on, run_chunk, (inner, jnp.int32(0)))[0]
    return jax.vmap(partial(recorder.finish, task))(domains, records, states), rewards, steps


def evaluate(
    task: Task, topology: Topology, recorder: Recorder, genomes: Genome, domains: Domain, keys: jax.Array
) -> Evaluation:
    """Evaluate B genomes, one episode each; `keys` (B,) decide the starts."""
    tests, n_tests = tests_of(task, domains)
    networks = jax.vmap(lambda genome: dnn.express(genome, topology))(genomes)
    networks = jax.tree.map(lambda leaf: jnp.repeat(leaf, n_tests, axis=0), networks)
    lanes = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(keys),) + (1,) * (leaf.ndim - 1)), tests)
    test_keys = jax.vmap(lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(jnp.arange(n_tests)))(keys)
    descriptions, rewards, steps = run(task, recorder, networks, lanes, test_keys.reshape(-1))
    result = Evaluation(rewards / task.reward, steps, descriptions)
    return jax.tree.map(lambda leaf: leaf.reshape(len(keys), n_tests, *leaf.shape[1:]), result)


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


def _expand(mask: jax.Array, like: jax.Array) -> jax.Array:
    return mask.reshape(mask.shape + (1,) * (like.ndim - mask.ndim))
