"""Q-learning with extracted actions and sensors (sections III-A and IV-E)."""

from qboot.qlearning.acting import epsilon
from qboot.qlearning.inputs import InputSet, input_set
from qboot.qlearning.learner import EpisodeInfo, LearnerState, init, learn
from qboot.qlearning.learners import LEARNERS, Learner
from qboot.qlearning.networks import QNetworks, init_networks, q_value, q_values
from qboot.qlearning.policy import Rollout, evaluate, rollout
from qboot.qlearning.problem import Problem, check_problem, networks_template, trajectory_capacity
from qboot.qlearning.rewards import smdp_target
from qboot.qlearning.settings import LearnerSettings

__all__ = [
    "LEARNERS",
    "EpisodeInfo",
    "InputSet",
    "Learner",
    "LearnerSettings",
    "LearnerState",
    "Problem",
    "QNetworks",
    "Rollout",
    "check_problem",
    "epsilon",
    "evaluate",
    "init",
    "init_networks",
    "input_set",
    "learn",
    "networks_template",
    "q_value",
    "q_values",
    "rollout",
    "smdp_target",
    "trajectory_capacity",
]
