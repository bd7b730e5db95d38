"""What an episode of Q-learning costs, by its sizes and the rates of a machine."""

from typing import NamedTuple

import jax

from qboot.envs.task import Domain, Task
from qboot.qlearning.settings import LearnerSettings
from qboot.study.pipeline.profiles import Costs


class Episode(NamedTuple):
    """An episode of Q-learning, as far as its cost goes."""

    settings: LearnerSettings
    rollouts_per_domain: int
    n_rollouts: int
    n_steps: int
    n_actions: int
    n_inputs: float
    duration: float  # mean of the actions, in steps

    def seconds(self, costs: Costs) -> float:
        """Core-seconds, once as many trajectories are replayed as can be kept."""
        steps = self.n_steps * costs.lived
        decisions = self.n_rollouts * steps / self.duration
        replayed = decisions * self.settings.eta / self.rollouts_per_domain
        update = costs.update + costs.weight * n_weights(self.n_actions, self.n_inputs, self.settings.hidden)
        return self.n_rollouts * steps * costs.acting_step + (decisions + replayed) * update


def n_weights(n_actions: int, n_inputs: float, hidden: int) -> float:
    """Input weights of all networks of a Q-learner."""
    return n_actions * n_inputs * hidden


def n_rollouts(task: Task, domains: Domain) -> int:
    """Rollouts of an episode."""
    return len(jax.tree.leaves(domains)[0]) * task.rollouts_per_domain
