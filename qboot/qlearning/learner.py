"""Q-learning over extracted actions, with replay of the best trajectories (section IV-E).

One learner is a pair of pure functions, `init` and `learn`, on arrays. Both work under `jax.vmap`: over keys,
and over action sets and inputs padded to one size. All batched learners then go through their decisions in
step, and one that has finished its test waits. On a CPU, `jax.lax.map` gives the same results without the
waiting.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import ActionSet
from qboot.qlearning.acting import epsilon, run_test
from qboot.qlearning.inputs import InputSet
from qboot.qlearning.networks import QNetworks, init_networks
from qboot.qlearning.replay import Trajectory, empty_store, keep_best, replay_best
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import usable_actions


class LearnerState(NamedTuple):
    """Everything that a learner needs to go on."""

    networks: QNetworks
    store: Trajectory  # the best trajectories of each domain, leading axes (D, eta)
    episode: jax.Array  # () int32 episodes done
    key: jax.Array  # the learner's only source of randomness


class EpisodeInfo(NamedTuple):
    """What happened in one episode. The last two are not finite once the learner has diverged."""

    score: jax.Array  # (D,) rewards earned
    discounted_return: jax.Array  # (D,) sum over the tests of their discounted returns
    steps: jax.Array  # (D,) int32 primitive steps
    decisions: jax.Array  # (D,) int32 actions executed
    td_error: jax.Array  # () mean |target - Q| over all updates, replay included
    largest_q: jax.Array  # () largest |Q(s, a)| of all actions at the decisions


def trajectory_capacity(task: Task, actions: ActionSet) -> int:
    """Return how many actions a test has room for, whichever are chosen; `actions` may have leading axes.

    Raises `ValueError` when a set has no action of positive duration.
    """
    durations = np.asarray(actions.durations)
    if not (durations > 0).any(axis=-1).all():
        raise ValueError("every action set needs at least one action of positive duration.")
    return -(-task.max_steps // int(durations[durations > 0].min()))


def init(
    key: jax.Array,
    task: Task,
    domains: Domain,
    actions: ActionSet,
    inputs: InputSet,
    settings: LearnerSettings,
    capacity: int | None = None,
    networks: QNetworks | None = None,
) -> LearnerState:
    """Return a learner that has not seen anything yet.

    `domains` are stacked on a leading axis D. Actions of duration 0 and inputs outside the mask are padding.
    `capacity` defaults to `trajectory_capacity`; it has to be given where `actions` is traced. `networks`
    lets a learner start on a target set with what was learned on the source set.

    Raises `ValueError` when actions or inputs do not fit the task, the settings or the networks.
    """
    n_actions, n_effectors = actions.slopes.shape
    n_inputs = inputs.lags.shape[0]
    if n_effectors != len(task.effectors):
        raise ValueError(f"{task.name} has {len(task.effectors)} effectors, the actions have {n_effectors}.")
    if not isinstance(inputs.lags, jax.core.Tracer):
        check_inputs(inputs, task, settings)
    if networks is None:
        networks = init_networks(jax.random.fold_in(key, 0), n_actions, n_inputs, settings.hidden)
    shape = (n_actions, settings.hidden, n_inputs)
    if networks.hidden_weights.shape != shape:
        raise ValueError(f"the networks must be of shape {shape}, got {networks.hidden_weights.shape}.")
    capacity = trajectory_capacity(task, actions) if capacity is None else capacity
    store = empty_store(jax.tree.leaves(domains)[0].shape[0], settings.eta, capacity, n_inputs)
    return LearnerState(networks, store, jnp.int32(0), jax.random.fold_in(key, 1))


def check_inputs(inputs: InputSet, task: Task, settings: LearnerSettings) -> None:
    """Raise `ValueError` when an input has a lag that is not remembered or a sensor that does not exist."""
    if not 1 <= int(inputs.lags.min()) <= int(inputs.lags.max()) <= settings.lags:
        raise ValueError(f"the lags of inputs must lie between 1 and settings.lags = {settings.lags}.")
    if not 0 <= int(inputs.sensors.min()) <= int(inputs.sensors.max()) < len(task.sensors):
        raise ValueError(f"the sensors of inputs must lie between 0 and {len(task.sensors) - 1}.")


@partial(jax.jit, static_argnames=("task", "settings", "n_episodes"))
def learn(
    state: LearnerState,
    task: Task,
    domains: Domain,
    actions: ActionSet,
    inputs: InputSet,
    settings: LearnerSettings,
    n_episodes: int,
) -> tuple[LearnerState, EpisodeInfo]:
    """Learn for `n_episodes` episodes; everything else as given to `init`.

    An episode is `task.rollouts_per_domain` tests in each domain, one domain after the other, with an update
    after every action; then the replay. Learning 10 episodes twice is learning 20 at once, to the byte.

    Returns the state and one `EpisodeInfo` per episode, stacked on a leading axis.
    """
    n_domains = jax.tree.leaves(domains)[0].shape[0]
    n_tests = n_domains * task.rollouts_per_domain
    capacity = state.store.actions.shape[-1]

    def episode(state: LearnerState, _: None) -> tuple[LearnerState, EpisodeInfo]:
        key = jax.random.fold_in(state.key, state.episode)
        exploration = epsilon(state.episode, settings)

        def test(carry: tuple[QNetworks, Trajectory], index: jax.Array) -> tuple:
            networks, store = carry
            place = index // task.rollouts_per_domain
            domain = jax.tree.map(lambda leaf: leaf[place], domains)
            test_key = jax.random.fold_in(key, index)
            ended = run_test(networks, test_key, task, domain, actions, inputs, settings, exploration, capacity)
            store = keep_best(store, place, ended.trajectory)
            summary = (
                ended.rewards / task.reward,
                ended.earned.value,
                ended.situation.step,
                ended.trajectory.length,
                ended.error_sum,
                ended.largest_q,
            )
            return (ended.networks, store), summary

        (networks, store), summary = lax.scan(test, (state.networks, state.store), jnp.arange(n_tests))
        *per_test, error_sums, largest_q = summary
        networks, replay_error_sum, replayed = replay_best(
            networks, jax.random.fold_in(key, n_tests), store, usable_actions(actions), settings
        )
        score, discounted_return, steps, decisions = (
            jnp.sum(leaf.reshape(n_domains, task.rollouts_per_domain), axis=1) for leaf in per_test
        )
        info = EpisodeInfo(
            score,
            discounted_return,
            steps,
            decisions,
            td_error=(jnp.sum(error_sums) + replay_error_sum) / (jnp.sum(decisions) + replayed),
            largest_q=jnp.max(largest_q),
        )
        return LearnerState(networks, store, state.episode + 1, state.key), info

    return lax.scan(episode, state, length=n_episodes)
