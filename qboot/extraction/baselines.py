"""Actions and sensors that nothing was learned for: drawn at random, or said by an expert (section VII)."""

from collections.abc import Mapping, Sequence

import numpy as np

from qboot.extraction.actions import ActionSet


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


def constant_actions(levels: np.ndarray, duration: int) -> ActionSet:
    """Actions that send constant commands.

    Args:
        levels: (A, E) in [0, 1].
        duration: of each action, in steps, >= 1.

    Raises:
        ValueError: if `duration` is less than 1.
    """
    if duration < 1:
        raise ValueError(f"duration must be at least 1 step, got {duration}.")
    levels = levels.astype(np.float32)
    return ActionSet(np.zeros_like(levels), levels, np.full(len(levels), duration, np.int32))


def named_sensors(sensors: Sequence[str], chosen: Mapping[int, Sequence[str]]) -> np.ndarray:
    """A selection (L, S) bool of the sensors named in `chosen` by lag; lag 1 is now, L the largest lag.

    Raises:
        ValueError: if a name is not among the S `sensors`, or a lag is below 1.
    """
    unknown = {name for names in chosen.values() for name in names} - set(sensors)
    if unknown:
        raise ValueError(f"there is no sensor {', '.join(sorted(unknown))}: choose among {', '.join(sensors)}")
    if not chosen or min(chosen) < 1:
        raise ValueError(f"lags are {sorted(chosen) or 'none'}: they must be at least 1, which is now")
    return np.array([[name in chosen.get(lag, ()) for name in sensors] for lag in range(1, max(chosen) + 1)])


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
