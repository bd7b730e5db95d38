"""What a human gives the Q-learner of ball collecting (section VII): actions and sensors designed by hand."""

import numpy as np

from qboot.envs.ball_collecting.dynamics import SENSORS
from qboot.extraction.actions import ActionSet
from qboot.extraction.baselines import constant_actions

SEEN = (
    "laser_front_right", "laser_front_left", "laser_front",
    "ball_right", "ball_left", "basket_right", "basket_left", "switch_right", "switch_left",
)  # fmt: skip
CHOSEN_SENSORS = (SENSORS, SEEN, SEEN)
"""The sensors that stand for the paper's human-chosen ones, which it does not list: all sensors as they are now, and
what the robot saw one and two decisions ago (to get round a wall, or back to a ball that has left its view)."""


def actions(duration: int = 15) -> ActionSet:
    """Sixteen moving actions that turn by different angles while holding, and one that stops and drops.

    Effectors are left wheel, right wheel (0.5 stops, 1 is full speed ahead) and crane (1 holds, 0 drops). No
    wheel ever turns backwards: a robot that spins on the spot does not explore. The first action turns to the right
    around its resting left wheel (a quarter of a circle in 15 steps), the ninth goes straight on.

    Args:
        duration: of each action, in steps, >= 1.

    Raises:
        ValueError: if `duration` is less than 1.
    """
    turns = np.arange(-8, 8) / 16  # from right to left; what the command of the inner wheel falls short of 1
    moving = np.column_stack([1 + np.minimum(turns, 0), 1 - np.maximum(turns, 0), np.ones(16)])
    return constant_actions(np.vstack([moving, [0.5, 0.5, 0.0]]), duration)
