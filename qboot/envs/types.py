"""What the method needs to know of a robot task.

Everything after the environments (evolution, extraction, Q-learning) talks to a task through this one tuple of pure
functions and numbers. A task of your own is one more `Task`; the Brax `Env` classes wrap the same functions.

Shape letters used everywhere: B controllers, D domains, T steps, S sensors, E effectors.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax


class TaskState(Protocol):
    """The fields that every task's state must have; a task adds its own."""

    observation: jax.Array  # (S,) sensors in [0, 1]
    reward: jax.Array  # () reward of the last step
    done: jax.Array  # () bool; a done state is absorbing: stepping it changes nothing and rewards nothing


Domain = Any  # a pytree of arrays: walls, positions, sizes; a set of domains has a leading axis D


class Task(NamedTuple):
    """A robot task as pure functions on arrays (all of them work under jit, vmap and scan).

    A *timestep* is one primitive step, a *rollout* one run of a controller in one domain. An *episode*, one evaluation
    of a policy, is `rollouts_per_domain` rollouts in each domain of a set; its score is the number of rewards earned.
    """

    name: str
    sensors: tuple[str, ...]
    effectors: tuple[str, ...]
    sources: tuple[str, ...]  # names of the source domain sets
    max_steps: int  # timesteps of one rollout at most
    rollouts_per_domain: int
    max_score_per_domain: int
    reward: float  # size of one reward (equations 7 and 8)
    feed_forward: bool  # whether evolved networks must be acyclic (appendix B)
    reset: Callable[[jax.Array, Domain], TaskState]  # (key, domain) -> state
    step: Callable[[Domain, TaskState, jax.Array], TaskState]  # (domain, state, (E,) commands in [0, 1]) -> state
    truncated: Callable[[TaskState], jax.Array]  # -> () bool: nothing happens any more, a rollout may stop here
    source_domains: Callable[[str], Domain]  # source name -> domains (D, ...)
    target_domains: Callable[[str], Domain]  # source name -> domains (D, ...), none of them in the source
    position: Callable[[Domain, TaskState], jax.Array]  # -> () int32: cell of the discretised trajectory
    outcome: Callable[[Domain, TaskState], jax.Array]  # -> (k,) vector compared by the ad hoc distance
    trajectory_period: int  # steps between two recorded cells
