"""The semi-Markov decision process: actions that run for their own durations (sections III-A and IV-B)."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import commands
from qboot.qlearning.inputs import first_history, remember
from qboot.qlearning.problem import Problem
from qboot.qlearning.rewards import DiscountedReward, join, no_reward


class SmdpState(NamedTuple):
    """Where a rollout stands."""

    state: Any  # the task's state
    history: jax.Array  # (lags, S) observations, the latest first
    step: jax.Array  # () int32 primitive steps done


def start_rollout(key: jax.Array, problem: Problem, domain: Domain) -> SmdpState:
    """The start of one rollout in one domain."""
    state = problem.task.reset(key, domain)
    return SmdpState(state, first_history(state.observation, problem.settings.lags), jnp.int32(0))


def is_ongoing(task: Task, smdp: SmdpState) -> jax.Array:
    """Whether the rollout goes on, () bool."""
    return ~smdp.state.done & (smdp.step < task.max_steps)


def primitive_step(
    problem: Problem, domain: Domain, action: jax.Array, elapsed: jax.Array, smdp: SmdpState
) -> SmdpState:
    """One primitive step of an action, () int32, `elapsed`, () int32, steps of which are done."""
    state = problem.task.step(domain, smdp.state, commands(problem.actions, action, elapsed))
    history = smdp.history
    if problem.settings.history == "steps":
        history = remember(history, state.observation)
    return SmdpState(state, history, smdp.step + 1)


def end_action(problem: Problem, smdp: SmdpState) -> SmdpState:
    """The state after the last step of an action, ready for the next decision."""
    if problem.settings.history == "decisions":
        return smdp._replace(history=remember(smdp.history, smdp.state.observation))
    return smdp


def execute(
    problem: Problem, domain: Domain, action: jax.Array, smdp: SmdpState
) -> tuple[SmdpState, DiscountedReward, jax.Array]:
    """Run one action, () int32, for its whole duration or until the rollout ends.

    Returns:
        The state after it, its discounted reward, and the plain sum () of its rewards. In a rollout that has
        ended, the task's state stays as it is and the rewards are 0.
    """
    first_step = smdp.step
    last_step = first_step + problem.actions.durations[action]

    def is_running(carry: tuple) -> jax.Array:
        smdp, _, _ = carry
        return (smdp.step < last_step) & is_ongoing(problem.task, smdp)

    def step(carry: tuple) -> tuple:
        smdp, discounted, total = carry
        smdp = primitive_step(problem, domain, action, smdp.step - first_step, smdp)
        reward = smdp.state.reward
        return smdp, join(discounted, DiscountedReward(reward, jnp.float32(problem.settings.gamma))), total + reward

    smdp, discounted, total = lax.while_loop(is_running, step, (smdp, no_reward(), jnp.float32(0)))
    return end_action(problem, smdp), discounted, total
