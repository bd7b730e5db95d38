"""The greedy policy of learned networks: its scores (figures 8, 15) and its behaviour (figures 7, 13)."""

from functools import partial
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
from jax import lax

from qboot import keys
from qboot.envs.task import Domain
from qboot.extraction.actions import commands
from qboot.qlearning.acting import choose, greedy
from qboot.qlearning.inputs import read_inputs
from qboot.qlearning.problem import Problem, assert_shapes
from qboot.qlearning.smdp import SmdpState, end_action, execute, is_ongoing, primitive_step, start_rollout


class Rollout(NamedTuple):
    """One rollout, step by step (T = the task's `max_steps`). Steps after its end have the mask false."""

    states: Any  # (T, ...) the task's state before the step
    commands: jax.Array  # (T, E)
    actions: jax.Array  # (T,) int32 action in force
    mask: jax.Array  # (T,) bool
    final: Any  # the task's state at the end


def greedy_action(networks: Any, problem: Problem, smdp: SmdpState) -> jax.Array:
    """Action of greatest value, () int32."""
    return greedy(values_of(networks, problem, smdp), problem.action_mask)


def values_of(networks: Any, problem: Problem, smdp: SmdpState) -> jax.Array:
    """Values (A,) of all actions."""
    return problem.learner.values(networks, read_inputs(problem.inputs, smdp.history, problem.settings))


@jax.jit
def evaluate(networks: Any, key: jax.Array, problem: Problem, exploration: jax.Array | None = None) -> jax.Array:
    """Score (D,) of the greedy policy in each domain, summed over the rollouts of one episode; nothing is learned.

    Args:
        networks: a learner's.
        key: random key of the episode.
        problem: its domains may be other ones than those of the training, and of any number.
        exploration: () probability of a random action instead, for an epsilon-greedy policy.

    Raises:
        AssertionError: if the shapes of the problem's arrays do not fit each other.
    """
    assert_shapes(problem)
    chex.assert_rank(key, 0)
    task = problem.task

    def score(index: jax.Array) -> jax.Array:
        domain, rollout_key = problem.domain(problem.place(index)), jax.random.fold_in(key, index)

        def action(smdp: SmdpState) -> jax.Array:
            if exploration is None:
                return greedy_action(networks, problem, smdp)
            decision_key = jax.random.fold_in(keys.key(rollout_key, "decisions"), smdp.step)
            return choose(decision_key, values_of(networks, problem, smdp), problem.action_mask, exploration)

        def decide(carry: tuple[SmdpState, jax.Array]) -> tuple[SmdpState, jax.Array]:
            smdp, total = carry
            smdp, _, reward = execute(problem, domain, action(smdp), smdp)
            return smdp, total + reward

        smdp = start_rollout(rollout_key, problem, domain)
        _, total = lax.while_loop(lambda carry: is_ongoing(task, carry[0]), decide, (smdp, jnp.float32(0)))
        return total / task.reward

    scores = lax.map(score, jnp.arange(problem.n_rollouts))
    return jnp.sum(scores.reshape(problem.n_domains, -1), axis=1)


@jax.jit
def rollout(networks: Any, key: jax.Array, problem: Problem, domain: Domain) -> Rollout:
    """One rollout of the greedy policy in one domain, recorded.

    Args:
        networks: a learner's.
        key: random key of the rollout: `fold_in(key, i)` gives the i-th rollout of `evaluate` with `key`.
        problem: its domains play no part.
        domain: a domain of the task.

    Raises:
        AssertionError: if the shapes of the problem's arrays do not fit each other.
    """
    assert_shapes(problem)
    chex.assert_rank(key, 0)
    chex.assert_trees_all_equal_structs(domain, problem.domain(0))

    def step(carry: tuple[SmdpState, jax.Array, jax.Array], _: None) -> tuple:
        smdp, action, elapsed = carry

        def go_on() -> tuple[SmdpState, jax.Array, jax.Array]:
            return smdp, action, elapsed

        def decide_again() -> tuple[SmdpState, jax.Array, jax.Array]:
            ended = end_action(problem, smdp)
            return ended, greedy_action(networks, problem, ended), jnp.int32(0)

        smdp, action, elapsed = lax.cond(elapsed == problem.actions.durations[action], decide_again, go_on)
        running = is_ongoing(problem.task, smdp)
        record = smdp.state, commands(problem.actions, action, elapsed), action, running
        after = primitive_step(problem, domain, action, elapsed, smdp)
        # The rewards of a rollout are in its last state: that stays as it is once the rollout is over.
        return (jax.tree.map(partial(jnp.where, running), after, smdp), action, elapsed + 1), record

    smdp = start_rollout(key, problem, domain)
    start = smdp, greedy_action(networks, problem, smdp), jnp.int32(0)
    record: Any
    (smdp, _, _), record = lax.scan(step, start, length=problem.task.max_steps)
    states, sent, actions, mask = record
    return Rollout(states, sent, actions, mask, final=smdp.state)
