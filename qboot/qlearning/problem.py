"""What a learner is to learn, with what, and how: all that stays the same from episode to episode."""

from dataclasses import dataclass, field
from typing import Any, TypeVar

import chex
import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.task import Domain, Task
from qboot.extraction.actions import ActionSet
from qboot.qlearning.inputs import InputSet
from qboot.qlearning.learners import LEARNERS, Learner
from qboot.qlearning.settings import LearnerSettings

Index = TypeVar("Index", int, jax.Array)
STATIC = {"static": True}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """A learner's problem; a pytree, so that it can be passed to `jax.jit` and, stacked, to `jax.vmap`.

    Stacked problems have the same task and settings, and one more leading axis in everything else.
    """

    task: Task = field(metadata=STATIC)
    settings: LearnerSettings = field(metadata=STATIC)
    domains: Domain  # leading axis D
    actions: ActionSet  # A of them; those of duration 0 are padding
    inputs: InputSet  # I of them; those outside the mask are padding

    @property
    def learner(self) -> Learner:
        """The learner that the settings name."""
        return LEARNERS[self.settings.algorithm]

    @property
    def action_mask(self) -> jax.Array:
        """Which actions can be executed, (A,) bool."""
        return jnp.asarray(self.actions.durations) > 0

    @property
    def n_actions(self) -> int:
        """A, padding included."""
        return self.actions.durations.shape[0]

    @property
    def n_inputs(self) -> int:
        """I, padding included."""
        return self.inputs.lags.shape[0]

    @property
    def n_domains(self) -> int:
        """D."""
        return jax.tree.leaves(self.domains)[0].shape[0]

    def new_networks(self, key: jax.Array) -> Any:
        """Networks that have learned nothing."""
        return self.learner.init(key, self.n_actions, self.n_inputs, self.settings.hidden)

    @property
    def n_rollouts(self) -> int:
        """Rollouts of one episode; those in one domain follow each other."""
        return self.n_domains * self.task.rollouts_per_domain

    def place(self, rollout: Index) -> Index:
        """Index () int32 of the domain of a rollout, () int32, of an episode."""
        return rollout // self.task.rollouts_per_domain

    def domain(self, place: jax.Array | int) -> Domain:
        """One of the domains, by its index, () int32."""
        return jax.tree.map(lambda leaf: leaf[place], self.domains)


def assert_shapes(problem: Problem) -> None:
    """Assert that the arrays of one problem fit each other and the task; works on traced ones.

    Raises:
        AssertionError: if a shape is not the one that `Problem` and its parts document.
    """
    actions, inputs = problem.actions, problem.inputs
    chex.assert_shape([actions.slopes, actions.intercepts], (problem.n_actions, len(problem.task.effectors)))
    chex.assert_shape(actions.durations, (problem.n_actions,))
    chex.assert_shape(list(inputs), (problem.n_inputs,))
    chex.assert_tree_shape_prefix(problem.domains, (problem.n_domains,))


def networks_template(problem: Problem) -> Any:
    """Structure, shapes and types of a problem's networks, as a tree of `jax.ShapeDtypeStruct`."""
    return jax.eval_shape(problem.new_networks, jax.random.key(0))


def check_problem(problem: Problem) -> None:
    """Refuse a problem whose values make no sense together; for arrays that are not traced, stacked or not.

    Raises:
        ValueError: if the actions or inputs do not fit the task or the settings.
    """
    task, settings = problem.task, problem.settings
    n_effectors = problem.actions.slopes.shape[-1]
    if n_effectors != len(task.effectors):
        raise ValueError(
            f"the actions must have the {len(task.effectors)} effectors of {task.name}, got {n_effectors}."
        )
    lags, sensors = np.asarray(problem.inputs.lags), np.asarray(problem.inputs.sensors)
    if not 1 <= lags.min() <= lags.max() <= settings.lags:
        raise ValueError(
            f"the lags of inputs must lie between 1 and settings.lags = {settings.lags}, "
            f"got {lags.min()} to {lags.max()}."
        )
    if not 0 <= sensors.min() <= sensors.max() < len(task.sensors):
        raise ValueError(
            f"the sensors of inputs must lie between 0 and {len(task.sensors) - 1}, "
            f"got {sensors.min()} to {sensors.max()}."
        )
    trajectory_capacity(problem)


def trajectory_capacity(problem: Problem) -> int:
    """How many actions a rollout has room for, whichever are chosen; for problems that are not traced, stacked or not.

    Raises:
        ValueError: if a set has no action of positive duration.
    """
    durations = np.asarray(problem.actions.durations)
    if not (durations > 0).any(axis=-1).all():
        raise ValueError("every action set needs at least one action of positive duration, got one without.")
    return -(-problem.task.max_steps // int(durations[durations > 0].min()))
