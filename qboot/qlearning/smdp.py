"""The semi-Markov decision process: actions that run for their own durations (sections III-A and IV-B)."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import ActionSet, commands
from qboot.qlearning.inputs import first_history, remember
from qboot.qlearning.settings import LearnerSettings


class Earned(NamedTuple):
    """What a stretch of primitive steps has earned."""

    value: jax.Array  # () sum_i gamma^(i - 1) r(t + i), i = 1 .. d
    discount: jax.Array  # () gamma^d


class Situation(NamedTuple):
    """Where a test stands."""

    state: Any  # the task's state
    history: jax.Array  # (lags, S) observations, the latest first
    step: jax.Array  # () int32 primitive steps done


def nothing_earned() -> Earned:
    """Return what no step at all earns."""
    return Earned(jnp.float32(0), jnp.float32(1))


def earn(earned: Earned, reward: jax.Array, gamma: float) -> Earned:
    """Add the reward () of one more step."""
    return Earned(earned.value + earned.discount * reward, earned.discount * gamma)


def earn_more(earned: Earned, later: Earned) -> Earned:
    """Add what a later stretch of steps earned."""
    return Earned(earned.value + earned.discount * later.value, earned.discount * later.discount)


def bootstrapped(earned: Earned, next_q_max: jax.Array, terminal: jax.Array) -> jax.Array:
    """Return the right-hand side () of equation 3; after the end of a test nothing is left to expect."""
    return earned.value + jnp.where(terminal, 0.0, earned.discount * next_q_max)


def smdp_target(rewards: jax.Array, gamma: float, next_q_max: jax.Array, terminal: jax.Array) -> jax.Array:
    """Return the value () that equation 3 gives to an action that earned `rewards` (d,), one per step.

    `next_q_max` () is max_a' Q(s(t + d), a'); it does not count where `terminal`, () bool, is true.
    """
    rewards = jnp.asarray(rewards, jnp.float32)

    def step(earned: Earned, reward: jax.Array) -> tuple[Earned, None]:
        return earn(earned, reward, gamma), None

    earned, _ = lax.scan(step, nothing_earned(), rewards)
    return bootstrapped(earned, next_q_max, terminal)


def usable_actions(actions: ActionSet) -> jax.Array:
    """Return which actions can be executed, (A,) bool: those of duration 0 are padding."""
    return actions.durations > 0


def start_test(key: jax.Array, task: Task, domain: Domain, settings: LearnerSettings) -> Situation:
    """Return the situation at the start of one test."""
    state = task.reset(key, domain)
    return Situation(state, first_history(state.observation, settings.lags), jnp.int32(0))


def is_ongoing(task: Task, situation: Situation) -> jax.Array:
    """Return whether the test goes on, () bool."""
    return ~situation.state.done & (situation.step < task.max_steps)


def execute(
    task: Task,
    domain: Domain,
    actions: ActionSet,
    action: jax.Array,
    situation: Situation,
    settings: LearnerSettings,
) -> tuple[Situation, Earned, jax.Array]:
    """Run one action, () int32, for its whole duration or until the test ends.

    Returns the situation after it, what it earned, and the plain sum () of its rewards. In a test that has
    ended, nothing happens.
    """
    first_step = situation.step
    last_step = first_step + actions.durations[action]

    def is_running(carry: tuple) -> jax.Array:
        situation, _, _ = carry
        return (situation.step < last_step) & is_ongoing(task, situation)

    def primitive_step(carry: tuple) -> tuple:
        situation, earned, rewards = carry
        command = commands(actions, action, situation.step - first_step)
        state = task.step(domain, situation.state, command)
        history = situation.history
        if settings.history == "steps":
            history = remember(history, state.observation)
        situation = Situation(state, history, situation.step + 1)
        return situation, earn(earned, state.reward, settings.gamma), rewards + state.reward

    situation, earned, rewards = lax.while_loop(
        is_running, primitive_step, (situation, nothing_earned(), jnp.float32(0))
    )
    if settings.history == "decisions":
        situation = situation._replace(history=remember(situation.history, situation.state.observation))
    return situation, earned, rewards
