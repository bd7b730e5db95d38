"""Action sets that nothing was learned for: designed by hand, or drawn at random (paper, section VII-A)."""

import numpy as np

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


def human_actions_box_pushing(duration: int = 9) -> ActionSet:
    """Stand still, or move at full speed along one of three axes, either way: seven actions.

    Args:
        duration: of each action, in steps, >= 1.

    Raises:
        ValueError: if `duration` is less than 1.
    """
    along = np.vstack([np.eye(3), -np.eye(3)])
    return _constant(0.5 + 0.5 * np.vstack([np.zeros(3), along]), duration)


HUMAN_ACTIONS = {"ball_collecting": human_actions_ball_collecting, "box_pushing": human_actions_box_pushing}


def _constant(levels: np.ndarray, duration: int) -> ActionSet:
    """Actions that send constant `levels` (A, E)."""
    if duration < 1:
        raise ValueError(f"duration must be at least 1 step, got {duration}.")
    levels = levels.astype(np.float32)
    return ActionSet(np.zeros_like(levels), levels, np.full(len(levels), duration, np.int32))
