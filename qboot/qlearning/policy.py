"""The greedy policy of learned networks: its scores (figures 8, 15) and its behaviour (figures 7, 13)."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import ActionSet, commands
from qboot.qlearning.inputs import InputSet, read_inputs, remember
from qboot.qlearning.networks import QNetworks, q_values
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import Situation, execute, is_ongoing, start_test, usable_actions


class Rollout(NamedTuple):
    """One test, step by step (T = the task's `max_steps`). Steps after its end have the mask false."""

    states: Any  # (T, ...) the task's state before the step
    commands: jax.Array  # (T, E)
    actions: jax.Array  # (T,) int32 action in force
    mask: jax.Array  # (T,) bool
    final: Any  # the task's state at the end


def greedy_action(
    networks: QNetworks, actions: ActionSet, inputs: InputSet, history: jax.Array, settings: LearnerSettings
) -> jax.Array:
    """Return the usable action of greatest value, () int32, given the history (lags, S)."""
    values = q_values(networks, read_inputs(inputs, history, settings))
    return jnp.argmax(jnp.where(usable_actions(actions), values, -jnp.inf))


@partial(jax.jit, static_argnames=("task", "settings"))
def evaluate(
    networks: QNetworks,
    key: jax.Array,
    task: Task,
    domains: Domain,
    actions: ActionSet,
    inputs: InputSet,
    settings: LearnerSettings,
) -> jax.Array:
    """Return the score (D,) of the greedy policy in each domain, summed over `task.rollouts_per_domain` tests.

    Nothing is learned. `domains` may be other ones than those of the training, and of any number.
    """
    n_domains = jax.tree.leaves(domains)[0].shape[0]

    def score(index: jax.Array) -> jax.Array:
        domain = jax.tree.map(lambda leaf: leaf[index // task.rollouts_per_domain], domains)

        def decide(carry: tuple[Situation, jax.Array]) -> tuple[Situation, jax.Array]:
            situation, total = carry
            action = greedy_action(networks, actions, inputs, situation.history, settings)
            situation, _, rewards = execute(task, domain, actions, action, situation, settings)
            return situation, total + rewards

        situation = start_test(jax.random.fold_in(key, index), task, domain, settings)
        _, total = lax.while_loop(lambda carry: is_ongoing(task, carry[0]), decide, (situation, jnp.float32(0)))
        return total / task.reward

    scores = lax.map(score, jnp.arange(n_domains * task.rollouts_per_domain))
    return jnp.sum(scores.reshape(n_domains, task.rollouts_per_domain), axis=1)


@partial(jax.jit, static_argnames=("task", "settings"))
def rollout(
    networks: QNetworks,
    key: jax.Array,
    task: Task,
    domain: Domain,
    actions: ActionSet,
    inputs: InputSet,
    settings: LearnerSettings,
) -> Rollout:
    """Record one test of the greedy policy in one domain.

    The key is that of the test: `fold_in(key, i)` gives the i-th test of `evaluate` with `key`.
    """

    def choose(situation: Situation) -> jax.Array:
        return greedy_action(networks, actions, inputs, situation.history, settings)

    def step(carry: tuple[Situation, jax.Array, jax.Array], _: None) -> tuple:
        situation, action, elapsed = carry
        is_over = elapsed == actions.durations[action]
        action = lax.cond(is_over, lambda: choose(situation), lambda: action)
        elapsed = jnp.where(is_over, 0, elapsed)
        command = commands(actions, action, elapsed)
        running = is_ongoing(task, situation)
        state = task.step(domain, situation.state, command)
        if settings.history == "steps":
            history = remember(situation.history, state.observation)
        else:
            ends = elapsed + 1 == actions.durations[action]
            history = jnp.where(ends, remember(situation.history, state.observation), situation.history)
        record = (situation.state, command, action, running)
        after = Situation(state, history, situation.step + 1)
        # What a test earns is in its last state: that stays as it is once the test is over.
        situation = jax.tree.map(partial(jnp.where, running), after, situation)
        return (situation, action, elapsed + 1), record

    situation = start_test(key, task, domain, settings)
    start = situation, choose(situation), jnp.int32(0)
    (situation, _, _), record = lax.scan(step, start, length=task.max_steps)
    return Rollout(*record, final=situation.state)
