"""Running networks in a task: many controllers, all domains, one compiled loop.

Shape letters: B controllers, D domains, n rollouts, L lanes in which they run side
by side, T steps, K computing neurons.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
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

# Steps between two looks at which rollouts still go on: so many at most, and so many looks a rollout.
CHUNK = 250
CHUNKS_PER_ROLLOUT = 20
# Controllers per compiled call: calls spread over the cores, and the last rollouts of each leave lanes empty.
BLOCK = 64

AnyArray = TypeVar("AnyArray", jax.Array, np.ndarray)


class Progress(NamedTuple):
    """How far rollouts have come; leading axis n or L on every leaf."""

    states: TaskState
    activities: jax.Array  # (n, K)
    rewards: jax.Array  # (n,) sum so far
    steps: jax.Array  # (n,) int32 lived so far
    summaries: Any  # by the recorder


class Evaluation(NamedTuple):
    """What evaluating B controllers gives."""

    scores: jax.Array  # (B, n) rewards earned in each rollout, in units of the task's reward
    steps: jax.Array  # (B, n) int32 steps lived
    descriptors: Any  # (B, n, ...) by the recorder


def rollouts_of(task: Task, domains: Domain) -> tuple[Domain, int]:
    """The domain of each rollout of an episode, leading axis n, and n."""
    rollouts = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), task.rollouts_per_domain, axis=0), domains)
    n_rollouts = len(jax.tree.leaves(rollouts)[0])
    chex.assert_tree_shape_prefix(rollouts, (n_rollouts,))
    return rollouts, n_rollouts


def run(
    task: Task, recorder: Recorder, networks: Network, domains: Domain, keys: jax.Array
) -> tuple[Any, jax.Array, jax.Array]:
    """Run n rollouts, each of its own network in its own domain, for `max_steps` or until it is done or truncated.

    `task.lanes` rollouts run side by side for a chunk of steps at a time. A rollout that is over by then leaves its
    lane to the next one, so that all lanes are in use until the last rollouts.

    Args:
        task: the task.
        recorder: what to keep of each rollout.
        networks: leading axis n.
        domains: leading axis n.
        keys: (n,) random keys for the starts.

    Returns:
        Descriptors by the recorder (n, ...), rewards (n,), steps lived (n,) int32.

    Raises:
        AssertionError: if leading axes differ.
    """
    chex.assert_rank(keys, 1)
    chex.assert_tree_shape_prefix((networks, domains), keys.shape)
    n_rollouts, n_lanes = len(keys), min(task.lanes, len(keys))
    chunk = max(1, min(CHUNK, task.max_steps // CHUNKS_PER_ROLLOUT))
    n_chunks = -(-task.max_steps // chunk)
    run_chunk = partial(_run_chunk, task, recorder, chunk)
    progress = Progress(
        jax.vmap(task.reset)(keys, domains),
        jax.vmap(dnn.rest)(networks),
        jnp.zeros(n_rollouts),
        jnp.zeros(n_rollouts, jnp.int32),
        # A summary starts the same for all rollouts.
        jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n_rollouts, *leaf.shape)), recorder.start(task)),
    )
    rows = jax.tree.map(
        lambda leaf: jnp.zeros((n_rollouts, n_chunks, *leaf.shape[1:]), leaf.dtype),
        jax.eval_shape(run_chunk, networks, domains, progress)[1],
    )

    def advance(carry):
        progress, rows = carry
        # Lanes for which there is no rollout repeat one that goes on, and write the same: one that is over would blank
        # the rows of its last chunk.
        places = _first(_goes_on(task, progress), n_lanes)
        here = jax.tree.map(lambda leaf: leaf[places], (networks, domains, progress))
        there, new_rows = run_chunk(*here)
        return _put(progress, there, (places,)), _put(rows, new_rows, (places, here[2].steps // chunk))

    progress, rows = jax.lax.while_loop(lambda carry: jnp.any(_goes_on(task, carry[0])), advance, (progress, rows))
    rows = jax.tree.map(
        lambda leaf: leaf.reshape(n_rollouts, n_chunks * chunk, *leaf.shape[3:])[:, : task.max_steps], rows
    )
    finish = jax.vmap(partial(recorder.finish, task))
    return finish(domains, progress.summaries, rows, progress.states), progress.rewards, progress.steps


def _run_chunk(
    task: Task, recorder: Recorder, n_steps: int, networks: Network, domains: Domain, progress: Progress
) -> tuple[Progress, Any]:
    """Go on with L rollouts for `n_steps` each; what they become, and the recorder's rows (L, n_steps, ...)."""

    def step(progress: Progress, _: None) -> tuple[Progress, Any]:
        alive = _goes_on(task, progress)
        # Every lane has its own weights, repeated if need be: a batch of matrix-vector products stays inside the
        # one kernel that the loop compiles to, a product with shared weights does not.
        activities = jax.vmap(dnn.step)(networks, progress.activities, progress.states.observation)
        commands = activities[:, : len(task.effectors)]
        summaries, rows = jax.vmap(partial(recorder.update, task))(
            domains, progress.summaries, Timestep(progress.states, commands)
        )
        states = jax.vmap(task.step)(domains, progress.states, commands)
        after = Progress(states, activities, progress.rewards + states.reward, progress.steps + 1, summaries)
        after = jax.tree.map(lambda new, old: jnp.where(expand(alive, new), new, old), after, progress)
        # Nobody asks for the activities of a rollout that is over.
        after = after._replace(activities=activities)
        return after, jax.tree.map(lambda row: jnp.where(expand(alive, row), row, jnp.zeros_like(row)), rows)

    progress, rows = jax.lax.scan(step, progress, None, n_steps)
    return progress, jax.tree.map(lambda leaf: jnp.swapaxes(leaf, 0, 1), rows)


def _first(mask: jax.Array, n: int) -> jax.Array:
    """Indices (n,) of the first n that are true in `mask` (N,), of which one is; the first again for want of more."""
    places = jnp.sum(jnp.cumsum(mask) <= jnp.arange(n)[:, None], axis=1)
    return jnp.where(places < len(mask), places, places[0])


def _put(tables: Any, values: Any, index: tuple[jax.Array, ...]) -> Any:
    """`tables` (N, ...) with `values` (L, ...) at `index`, a tuple of (L,) arrays."""

    def put_one(i, tables):
        at = [part[i] for part in index]
        return jax.tree.map(
            lambda table, value: jax.lax.dynamic_update_slice(
                table, value[i].reshape((1,) * len(at) + value.shape[1:]), (*at, *[0] * (table.ndim - len(at)))
            ),
            tables,
            values,
        )

    return jax.lax.fori_loop(0, len(index[0]), put_one, tables)


def _goes_on(task: Task, progress: Progress) -> jax.Array:
    """Which rollouts (n,) are neither done nor truncated nor at their last step."""
    return ~progress.states.done & ~jax.vmap(task.truncated)(progress.states) & (progress.steps < task.max_steps)


@partial(jax.jit, static_argnames=("task", "settings", "recorder"))
def evaluate(
    task: Task, settings: DnnSettings, recorder: Recorder, domains: Domain, genomes: Genome, keys: jax.Array
) -> Evaluation:
    """Evaluate B genomes, one episode each in the `domains` (D, ...); `keys` (B,) decide the starts.

    Raises:
        AssertionError: if leading axes differ, or genomes do not have the shapes that the settings say.
    """
    chex.assert_rank(keys, 1)
    chex.assert_tree_shape_prefix(genomes, keys.shape)
    rollouts, n_rollouts = rollouts_of(task, domains)
    networks = jax.vmap(lambda genome: dnn.express(genome, settings))(genomes)
    networks = jax.tree.map(lambda leaf: jnp.repeat(leaf, n_rollouts, axis=0), networks)
    lanes = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(keys),) + (1,) * (leaf.ndim - 1)), rollouts)
    rollout_keys = jax.vmap(lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(jnp.arange(n_rollouts)))(keys)
    descriptors, rewards, steps = run(task, recorder, networks, lanes, rollout_keys.reshape(-1))
    result = Evaluation(rewards / task.reward, steps, descriptors)
    return jax.tree.map(lambda leaf: leaf.reshape(len(keys), n_rollouts, *leaf.shape[1:]), result)


def evaluate_all(
    task: Task,
    settings: DnnSettings,
    recorder: Recorder,
    domains: Domain,
    genomes: Genome,
    keys: jax.Array,
    workers: int,
    room: int | None = None,
    block: int | None = None,
) -> Evaluation:
    """`evaluate` with no more room for hidden neurons than needed, in blocks spread over threads; NumPy arrays.

    All but the last three arguments are those of `evaluate`. `workers` is the number of threads, which changes nothing;
    `room` the number of hidden neurons, which changes how the last bit is rounded: None is the least that all fit into;
    `block` the controllers of each call, another number of which is another program: None is B, or `BLOCK` if that is
    less.
    """
    settings = replace(settings, max_hidden=dnn.least_room(genomes, settings) if room is None else room)
    function = partial(evaluate, task, settings, recorder, domains)
    block = min(BLOCK, len(keys)) if block is None else block
    return in_blocks(function, workers, block, dnn.cropped(genomes, settings), keys)


def in_blocks(function: Callable, workers: int, block: int, *batched):
    """Call a compiled `function` on `block` rows at a time of the leading axis of `batched`, spread over threads.

    A result does not depend on the number of workers. The last block is filled up with repetitions, so that one
    compiled program serves all.

    Returns:
        The results, as NumPy arrays, joined along the leading axis.
    """
    n = len(jax.tree.leaves(batched)[0])

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
