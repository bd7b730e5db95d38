"""Q-learning with extracted actions and sensors (sections III-A and IV-E)."""

from qboot.qlearning.acting import epsilon
from qboot.qlearning.inputs import InputSet, input_set
from qboot.qlearning.learner import EpisodeInfo, LearnerState, init, learn, trajectory_capacity
from qboot.qlearning.networks import QNetworks, init_networks, q_value, q_values
from qboot.qlearning.policy import Rollout, evaluate, rollout
from qboot.qlearning.settings import LearnerSettings
from qboot.qlearning.smdp import smdp_target

__all__ = [
    "EpisodeInfo",
    "InputSet",
    "LearnerSettings",
    "LearnerState",
    "QNetworks",
    "Rollout",
    "epsilon",
    "evaluate",
    "init",
    "init_networks",
    "input_set",
    "learn",
    "q_value",
    "q_values",
    "rollout",
    "smdp_target",
    "trajectory_capacity",
]
