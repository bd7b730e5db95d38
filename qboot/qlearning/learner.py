"""Q-learning over extracted actions, with replay of the best trajectories (section IV-E).

One learner is a pair of pure functions, `init` and `learn`, on arrays. Both work under `jax.vmap`: over keys,
and over problems whose action sets and inputs are padded to one size. All batched learners then go through
their decisions in step, and one that has finished its rollout waits. On a CPU, `jax.lax.map` gives the same
results without the waiting.
"""

from functools import partial
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
from jax import lax

from qboot import keys
from qboot.qlearning.acting import epsilon, run_rollout
from qboot.qlearning.problem import Problem, assert_shapes, networks_template, trajectory_capacity
from qboot.qlearning.replay import Trajectory, empty_store, keep_best


class LearnerState(NamedTuple):
    """Everything that a learner needs to go on."""

    networks: Any  # whatever the learner's `init` returns (`QNetworks` of q_learning)
    store: Trajectory  # the best trajectories of each domain, leading axes (D, eta)
    episode: jax.Array  # () int32 episodes done: exploration goes by them
    key: jax.Array  # the learner's only source of randomness


class EpisodeInfo(NamedTuple):
    """What happened in one episode; `learn` stacks those of all its episodes on a leading axis.

    The last two are not finite once the learner has diverged.
    """

    score: jax.Array  # (D,) number of rewards received
    discounted_return: jax.Array  # (D,) sum over the rollouts of their discounted returns
    steps: jax.Array  # (D,) int32 primitive steps
    decisions: jax.Array  # (D,) int32 actions executed
    td_error: jax.Array  # () mean |target - Q| over all updates, replay included
    largest_q: jax.Array  # () largest |Q(s, a)| of all actions at the decisions


def init(
    key: jax.Array, problem: Problem, capacity: int | None = None, networks: Any = None, episode: int = 0
) -> LearnerState:
    """A learner that has not seen anything of its problem yet.

    Args:
        key: random key of the learner.
        problem: what it is to learn; `problem.check_problem` says whether its values make sense.
        capacity: actions that a trajectory has room for; default `trajectory_capacity`. It has to be given
            where `problem` is traced.
        networks: to go on from, such as those learned on the source set; default new ones.
        episode: episodes that it has done elsewhere; exploration goes on from there.

    Raises:
        AssertionError: if the shapes of the problem's arrays do not fit each other.
        ValueError: if the networks do not fit the problem.
    """
    assert_shapes(problem)
    chex.assert_rank(key, 0)
    if networks is None:
        networks = problem.new_networks(keys.key(key, "networks"))
    expected, found = (jax.tree.map(jnp.shape, some) for some in (networks_template(problem), networks))
    if found != expected:
        raise ValueError(f"the networks must have the shapes {expected}, got {found}.")
    capacity = trajectory_capacity(problem) if capacity is None else capacity
    store = empty_store(problem.n_domains, problem.settings.eta, capacity, problem.n_inputs)
    return LearnerState(networks, store, jnp.int32(episode), keys.key(key, "episodes"))


@partial(jax.jit, static_argnames="n_episodes")
def learn(state: LearnerState, problem: Problem, n_episodes: int) -> tuple[LearnerState, EpisodeInfo]:
    """Learn for `n_episodes` episodes.

    An episode is the problem's rollouts in each domain, one domain after the other, with an update after
    every action; then the replay. Learning 10 episodes twice is learning 20 at once, to the byte.

    Returns:
        The state, and one `EpisodeInfo` per episode, stacked on a leading axis.

    Raises:
        AssertionError: if the shapes of the problem's arrays do not fit each other, or the state's not the problem.
    """
    assert_shapes(problem)
    chex.assert_tree_shape_prefix(state.store, (problem.n_domains, problem.settings.eta))
    chex.assert_shape(state.store.inputs, (..., problem.n_inputs))
    chex.assert_rank([state.episode, state.key], 0)
    settings, task = problem.settings, problem.task
    capacity = state.store.actions.shape[-1]

    def episode(state: LearnerState, _: None) -> tuple[LearnerState, EpisodeInfo]:
        key = jax.random.fold_in(state.key, state.episode)
        rollouts_key = keys.key(key, "rollouts")
        exploration = epsilon(state.episode, settings)

        def rollout(carry: tuple[Any, Trajectory], index: jax.Array) -> tuple:
            networks, store = carry
            place = problem.place(index)
            rollout_key = jax.random.fold_in(rollouts_key, index)
            ended = run_rollout(networks, rollout_key, problem, problem.domain(place), exploration, capacity)
            store = keep_best(store, place, ended.trajectory)
            summary = (
                ended.reward / task.reward,
                ended.discounted_reward.value,
                ended.smdp.step,
                ended.trajectory.length,
                ended.error_sum,
                ended.largest_q,
            )
            return (ended.networks, store), summary

        summary: tuple
        (networks, store), summary = lax.scan(rollout, (state.networks, state.store), jnp.arange(problem.n_rollouts))
        *per_rollout, error_sums, largest_q = summary
        networks, replay_error_sum, replayed = problem.learner.replay(
            networks, keys.key(key, "replay"), store, problem.action_mask, settings.alpha
        )
        score, discounted_return, steps, decisions = (
            jnp.sum(leaf.reshape(problem.n_domains, -1), axis=1) for leaf in per_rollout
        )
        info = EpisodeInfo(
            score,
            discounted_return,
            steps,
            decisions,
            td_error=(jnp.sum(error_sums) + replay_error_sum) / (jnp.sum(decisions) + replayed).astype(jnp.float32),
            largest_q=jnp.max(largest_q),
        )
        return LearnerState(networks, store, state.episode + 1, state.key), info

    return lax.scan(episode, state, length=n_episodes)
