"""Actions and sensors that nothing was learned for: designed by hand, or drawn at random (section VII)."""

import numpy as np

from qboot.envs import TASKS
from qboot.envs.box_pushing import arm
from qboot.extraction.actions import ActionSet

# Durations of random actions: shortest and longest, in steps.
RANDOM_DURATIONS = {"ball_collecting": (5, 25), "box_pushing": (2, 20)}


def random_actions(seed: int, n_actions: int, n_effectors: int, durations: tuple[int, int]) -> ActionSet:
    """Lines between two values drawn from [0, 1] for the two ends of each action, per effector.

    Args:
        seed: decides values and durations.
        n_actions: A, >= 1.
        n_effectors: E, >= 1.
        durations: shortest and longest, in steps, both possible, 1 <= shortest <= longest.

    Raises:
        ValueError: when an argument lies outside the range given above.
    """
    shortest, longest = durations
    if n_actions < 1 or n_effectors < 1:
        raise ValueError(f"n_actions and n_effectors must be at least 1, got {n_actions} and {n_effectors}.")
    if not 1 <= shortest <= longest:
        raise ValueError(f"durations must be (shortest, longest), 1 <= shortest <= longest, got {durations}.")
    random = np.random.default_rng(seed)
    first, last = random.uniform(size=(2, n_actions, n_effectors))
    steps = random.integers(shortest, longest, size=n_actions, endpoint=True)
    slopes = np.where(steps[:, None] > 1, (last - first) / np.maximum(steps[:, None] - 1, 1), 0.0)
    return ActionSet(slopes.astype(np.float32), first.astype(np.float32), steps.astype(np.int32))


def human_actions_ball_collecting(duration: int = 15) -> ActionSet:
    """Sixteen moving actions that turn by different angles while holding, and one that stops and drops.

    Effectors are left wheel, right wheel (0.5 stops, 1 is full speed ahead) and crane (1 holds, 0 drops). No
    wheel ever turns backwards: a robot that spins on the spot does not explore. The first action turns to the left
    around its resting left wheel (a quarter of a circle in 15 steps), the ninth goes straight on.

    Args:
        duration: of each action, in steps, >= 1.

    Raises:
        ValueError: if `duration` is less than 1.
    """
    turns = np.arange(-8, 8) / 16  # from left to right; what the command of the inner wheel falls short of 1
    moving = np.column_stack([1 + np.minimum(turns, 0), 1 - np.maximum(turns, 0), np.ones(16)])
    return _constant(np.vstack([moving, [0.5, 0.5, 0.0]]), duration)


def human_actions_box_pushing(duration: int = 9, distance: float = 0.04) -> ActionSet:
    """Stand still, or move by a fixed distance along one of three axes, either way: seven actions.

    Args:
        duration: of each action, in steps, >= 1.
        distance: of each move, in metres; 4 cm is the width of the window in which a push counts as centred.

    Raises:
        ValueError: if `duration` is less than 1, or too short for the distance at full speed.
    """
    if not 0 < distance <= duration * arm.LONGEST_STEP.min():
        farthest = duration * arm.LONGEST_STEP.min()
        raise ValueError(f"distance must lie above 0 and up to {farthest:.3g} m in {duration} steps, got {distance}.")
    along = np.diag(distance / duration / arm.STEP_PER_COMMAND)
    return _constant(0.5 + np.vstack([np.zeros(3), along, -along]), duration)


HUMAN_ACTIONS = {"ball_collecting": human_actions_ball_collecting, "box_pushing": human_actions_box_pushing}


# Sensors that an expert would have remembered, by lag; 1 is now.
_BALL_SEEN = (
    "laser_front_right", "laser_front_left", "laser_front",
    "ball_right", "ball_left", "basket_right", "basket_left", "switch_right", "switch_left",
)  # fmt: skip
_HAND_SEEN = ("hand_x", "hand_y", "hand_z", "hand_x_from_block", "hand_y_from_block")
HUMAN_SENSORS = {
    "ball_collecting": {1: TASKS["ball_collecting"].sensors, 2: _BALL_SEEN, 3: _BALL_SEEN},
    "box_pushing": {1: TASKS["box_pushing"].sensors, 2: _HAND_SEEN},
}
"""The sensors that stand for the paper's human-chosen ones, which it does not list: all sensors as they are now; of
the robot also what it saw one and two decisions ago (to get round a wall, or back to a ball that has left its view);
of the arm also where the hand was (so that it knows where it is going)."""


def human_sensors(task: str) -> np.ndarray:
    """HUMAN_SENSORS of a task as a selection (lags, S) bool."""
    sensors, chosen = TASKS[task].sensors, HUMAN_SENSORS[task]
    return np.array([[name in chosen[lag] for name in sensors] for lag in sorted(chosen)])


def random_sensors(seed: int, lags: int, n_sensors: int, n_inputs: int | None = None) -> np.ndarray:
    """Draw inputs among `n_sensors` sensors at `lags` lags, all equally likely (paper, section VII-B).

    Args:
        seed: decides which, and how many.
        lags: L, >= 1.
        n_sensors: S, >= 1.
        n_inputs: how many, 1 to L S; None draws their number uniformly from that range.

    Returns:
        A selection (L, S) bool.

    Raises:
        ValueError: when an argument lies outside the range given above.
    """
    total = lags * n_sensors
    if lags < 1 or n_sensors < 1:
        raise ValueError(f"lags and n_sensors must be at least 1, got {lags} and {n_sensors}.")
    if n_inputs is not None and not 1 <= n_inputs <= total:
        raise ValueError(f"n_inputs must lie between 1 and {total}, got {n_inputs}.")
    random = np.random.default_rng(seed)
    if n_inputs is None:
        n_inputs = int(random.integers(1, total, endpoint=True))
    selection = np.zeros(total, bool)
    selection[random.choice(total, n_inputs, replace=False)] = True
    return selection.reshape(lags, n_sensors)


def _constant(levels: np.ndarray, duration: int) -> ActionSet:
    """Actions that send constant `levels` (A, E)."""
    if duration < 1:
        raise ValueError(f"duration must be at least 1 step, got {duration}.")
    levels = levels.astype(np.float32)
    return ActionSet(np.zeros_like(levels), levels, np.full(len(levels), duration, np.int32))
