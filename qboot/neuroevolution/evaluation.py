"""Running networks in a task: many controllers, all domains, one compiled loop.

Shape letters: B controllers, D domains, n = D `rollouts_per_domain` rollouts, L = B n lanes that run side by side,
T steps, K computing neurons.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple, TypeVar

import chex
import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.task import Domain, Task, TaskState
from qboot.neuroevolution import dnn
from qboot.neuroevolution.dnn import DnnSettings, Genome, Network
from qboot.neuroevolution.recorders import Recorder, Timestep

# Steps between two looks at which lanes still run: so many at most, and so many looks a rollout.
CHUNK = 250
CHUNKS_PER_ROLLOUT = 20
# The batch shrinks to these shares of its first size as lanes are over.
BATCH_SHARES = (1, 4, 16)
# Smaller batches, as those of a single network, are not worth a compiled loop for each share.
SMALLEST_SHARED = 16
# Controllers per compiled call on a CPU: their data stays in the cache, and calls spread over the cores.
BLOCK = 16


AnyArray = TypeVar("AnyArray", jax.Array, np.ndarray)
# All lanes are at the same time.
LANES_OF_TIMESTEP: Any = Timestep(None, 0, 0, 0)  # type: ignore[arg-type]


class Lanes(NamedTuple):
    """Rollouts that run side by side; leading axis L on every leaf."""

    domains: Domain
    networks: Network
    states: TaskState
    activities: jax.Array  # (L, K)
    rewards: jax.Array  # (L,) sum so far
    steps: jax.Array  # (L,) int32 lived so far
    records: Any


class Evaluation(NamedTuple):
    """What evaluating B controllers gives."""

    scores: jax.Array  # (B, n) rewards earned in each rollout, in units of the task's reward
    steps: jax.Array  # (B, n) int32 steps lived
    descriptors: Any  # (B, n, ...) by the recorder


def rollouts_of(task: Task, domains: Domain) -> tuple[Domain, int]:
    """The domain of each rollout of an episode, leading axis n, and n."""
    rollouts = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), task.rollouts_per_domain, axis=0), domains)
    return rollouts, len(jax.tree.leaves(rollouts)[0])


def run(
    task: Task, recorder: Recorder, networks: Network, domains: Domain, keys: jax.Array
) -> tuple[Any, jax.Array, jax.Array]:
    """Run L networks, each in its own domain, for the task's `max_steps` or until all are done or truncated.

    Lanes that are over are dropped from the batch: once no more than a quarter of them run, the loop goes on with a
    quarter of the batch, then with a sixteenth.

    Args:
        task: the task.
        recorder: what to keep of each rollout.
        networks: leading axis L.
        domains: leading axis L.
        keys: (L,) random keys for the starts.

    Returns:
        Descriptions by the recorder (L, ...), rewards (L,), steps lived (L,) int32.
    """
    n_lanes = len(keys)
    chunk = max(1, min(CHUNK, task.max_steps // CHUNKS_PER_ROLLOUT))
    n_chunks = -(-task.max_steps // chunk)
    # A record starts the same for all lanes.
    records = jax.tree.map(
        lambda leaf: jnp.broadcast_to(leaf, (n_lanes, *leaf.shape)), recorder.start(task, task.max_steps)
    )
    activities = jax.vmap(dnn.rest)(networks)
    states = jax.vmap(task.reset)(keys, domains)
    lanes = Lanes(domains, networks, states, activities, jnp.zeros(n_lanes), jnp.zeros(n_lanes, jnp.int32), records)
    shares = BATCH_SHARES if n_lanes >= SMALLEST_SHARED else BATCH_SHARES[:1]
    sizes = [-(-n_lanes // share) for share in shares]
    first_chunk = jnp.int32(0)
    for size, next_size in zip(sizes, [*sizes[1:], 0], strict=True):
        # Places past the end fill up the batch; what happens in them is dropped.
        places = jnp.nonzero(_goes_on(task, lanes.states), size=size, fill_value=n_lanes)[0]
        batch = jax.tree.map(lambda leaf, places=places: leaf[jnp.minimum(places, n_lanes - 1)], lanes)

        def some_go_on(carry, places=places, next_size=next_size):
            batch, i = carry
            n_running = jnp.sum(_goes_on(task, batch.states) & (places < n_lanes))
            return (i < n_chunks) & (n_running > next_size)

        def run_chunk(carry):
            batch, i = carry
            return _run_steps(task, recorder, batch, i * chunk + jnp.arange(chunk)), i + 1

        batch, first_chunk = jax.lax.while_loop(some_go_on, run_chunk, (batch, first_chunk))
        lanes = jax.tree.map(lambda all, some, places=places: all.at[places].set(some, mode="drop"), lanes, batch)
    descriptors = jax.vmap(partial(recorder.finish, task))(domains, lanes.records, lanes.states)
    return descriptors, lanes.rewards, lanes.steps


def _run_steps(task: Task, recorder: Recorder, lanes: Lanes, times: jax.Array) -> Lanes:
    """Run all lanes for the steps `times` (chunk,) of their rollouts."""

    def step(lanes: Lanes, t: jax.Array) -> tuple[Lanes, None]:
        alive = _goes_on(task, lanes.states) & (t < task.max_steps)
        # Every lane has its own weights, repeated if need be: a batch of matrix-vector products stays inside the
        # one kernel that the loop compiles to, a product with shared weights does not.
        activities = jax.vmap(dnn.step)(lanes.networks, lanes.activities, lanes.states.observation)
        commands = activities[:, : len(task.effectors)]
        timesteps = Timestep(t, alive, lanes.states, commands)
        records = jax.vmap(partial(recorder.update, task), in_axes=(0, 0, LANES_OF_TIMESTEP))(
            lanes.domains, lanes.records, timesteps
        )
        after = jax.vmap(task.step)(lanes.domains, lanes.states, commands)
        after = jax.tree.map(lambda new, old: jnp.where(expand(alive, new), new, old), after, lanes.states)
        rewards = lanes.rewards + jnp.where(alive, after.reward, 0.0)
        steps = lanes.steps + alive.astype(jnp.int32)
        return Lanes(lanes.domains, lanes.networks, after, activities, rewards, steps, records), None

    return jax.lax.scan(step, lanes, times)[0]


def _goes_on(task: Task, states: TaskState) -> jax.Array:
    """Which rollouts (L,) are neither done nor truncated."""
    return ~states.done & ~jax.vmap(task.truncated)(states)


@partial(jax.jit, static_argnames=("task", "settings", "recorder"))
def evaluate(
    task: Task, settings: DnnSettings, recorder: Recorder, domains: Domain, genomes: Genome, keys: jax.Array
) -> Evaluation:
    """Evaluate B genomes, one episode each in the `domains` (D, ...); `keys` (B,) decide the starts."""
    chex.assert_equal_shape_prefix((genomes.weights, keys), 1)
    rollouts, n_rollouts = rollouts_of(task, domains)
    networks = jax.vmap(lambda genome: dnn.express(genome, settings))(genomes)
    networks = jax.tree.map(lambda leaf: jnp.repeat(leaf, n_rollouts, axis=0), networks)
    lanes = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(keys),) + (1,) * (leaf.ndim - 1)), rollouts)
    rollout_keys = jax.vmap(lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(jnp.arange(n_rollouts)))(keys)
    descriptors, rewards, steps = run(task, recorder, networks, lanes, rollout_keys.reshape(-1))
    result = Evaluation(rewards / task.reward, steps, descriptors)
    return jax.tree.map(lambda leaf: leaf.reshape(len(keys), n_rollouts, *leaf.shape[1:]), result)


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


def expand(mask: AnyArray, like: AnyArray) -> AnyArray:
    """A mask (n,) with as many axes as `like` (n, ...), to choose between two such arrays."""
    return mask.reshape(mask.shape + (1,) * (like.ndim - mask.ndim))
