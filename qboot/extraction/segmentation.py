"""Cutting a flow of commands into linear segments (paper, section IV-C), by methods with names.

Another method is a function (commands (E, T), settings) -> Segments, and a row of SEGMENTATIONS.
Shape letters: E effectors, T steps, n segments.
"""

import contextlib
import logging
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:  # the settings choose one of the methods
    from qboot.extraction.actions import ActionSettings

# Added to the variance of a hidden state's commands, whose range is [0, 1], before it is fitted.
EMISSION_VARIANCE = 1e-4


class Segments(NamedTuple):
    """Linear models of the pieces of a flow, equation 5: Delta(t) = slope t + intercept, t = 0 .. d - 1."""

    slopes: np.ndarray  # (n, E) float64, per step
    intercepts: np.ndarray  # (n, E) float64, value at the segment's first step
    durations: np.ndarray  # (n,) int64 steps, >= 1


def split_points(commands: np.ndarray) -> np.ndarray:
    """The paper's function SPLIT POINTS (section IV-C): the steps at which a new action starts.

    A step is a candidate where the second derivative (mean of the absolute values over the effectors) exceeds
    its own mean over the flow. Of two candidates in a row the weaker is dropped (the first, when equal);
    of three or more only the first and the last are kept, so that a fast oscillation becomes one action.

    Args:
        commands: (E, T) values sent to the effectors.

    Returns:
        (T,) bool. The first and the last step, which have no second derivative, are never split points.

    Raises:
        ValueError: if `commands` is not two-dimensional, is empty or is not finite.
    """
    commands = _checked(commands)
    strength = np.zeros(commands.shape[1])
    # u(t-1) - 2 u(t) + u(t+1) as differences of differences: both sides of a sudden change are exactly equal.
    strength[1:-1] = np.abs(np.diff(commands, n=2)).mean(axis=0)
    candidate = strength > strength.mean()

    # Runs of candidates never touch the ends of the flow, so their starts and their ends alternate.
    change = np.flatnonzero(np.diff(candidate)) + 1
    first, last = change[::2], change[1::2] - 1
    pair = last == first + 1
    weaker_last = strength[last] < strength[first]
    points = np.zeros(len(candidate), bool)
    points[first[~pair | weaker_last]] = True
    points[last[~pair | ~weaker_last]] = True
    return points


def linear_segments(commands: np.ndarray, shortest: int = 1) -> Segments:
    """Least-squares lines (equation 5) between successive split points; the segments start at 0 and end at T.

    Args:
        commands: (E, T) values sent to the effectors.
        shortest: split points nearer to the one before, or to an end, are passed over, so that no segment is
            shorter (a flow that is shorter is one segment). With 1, all split points count.

    Returns:
        The segments; durations sum to T. A segment of one step has slope 0.

    Raises:
        ValueError: as `split_points`.
    """
    commands = _checked(commands)
    return _lines(commands, _spaced(np.flatnonzero(split_points(commands)), shortest, commands.shape[1]))


def hidden_state_segments(commands: np.ndarray, n_states: int, shortest: int = 1) -> Segments:
    """Least-squares lines (equation 5) of the runs of one hidden state of a Markov model with Gaussian emissions.

    The model is fitted to this flow alone, by expectation maximisation, and read by Viterbi's algorithm.

    Args:
        commands: (E, T) values sent to the effectors.
        n_states: hidden states at most; a flow with fewer different commands has no more states than those.
        shortest: as in `linear_segments`.

    Raises:
        ValueError: as `split_points`, and if hmmlearn is not installed.
    """
    commands = _checked(commands)
    # Commands that differ by less than a thousandth of their range are one: EM needs some spread.
    n_states = min(n_states, len(np.unique(commands.round(3), axis=1).T))
    if n_states == 1:
        return _lines(commands, np.array([0]))
    states = _hidden_states(commands.T, n_states)
    return _lines(commands, _spaced(np.flatnonzero(np.diff(states)) + 1, shortest, commands.shape[1]))


def _hidden_states(emissions: np.ndarray, n_states: int) -> np.ndarray:
    """The most likely hidden states (T,) of emissions (T, E)."""
    try:
        from hmmlearn.hmm import GaussianHMM
    except ImportError:
        raise ValueError("the segmentation 'hidden_markov' needs hmmlearn: pip install 'qboot[alternatives]'") from None
    from sklearn.exceptions import ConvergenceWarning

    model = GaussianHMM(n_states, covariance_type="diag", min_covar=EMISSION_VARIANCE, random_state=0)
    # It tells through its logger that it stopped before it converged, or that a state is never left.
    with _silent(logging.getLogger("hmmlearn")), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # of the k-means that it starts from
        return model.fit(emissions).predict(emissions)


@contextlib.contextmanager
def _silent(logger: logging.Logger) -> Iterator[None]:
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _lines(commands: np.ndarray, starts: np.ndarray) -> Segments:
    """Least-squares lines from each of the `starts` (n,) to the next, the last one to the end."""
    durations = np.diff(np.append(starts, commands.shape[1]))
    middle = (durations - 1) / 2
    time = np.arange(commands.shape[1]) - np.repeat(starts + middle, durations)  # 0 amid each segment
    spread = durations * (durations**2 - 1) / 12  # sum of time squared
    moment = np.add.reduceat(commands * time, starts, axis=1)
    slopes = moment / np.where(durations > 1, spread, 1)
    means = np.add.reduceat(commands, starts, axis=1) / durations
    return Segments(slopes.T, (means - slopes * middle).T, durations)


def cut_segments(segments: Segments, longest: int) -> Segments:
    """The same commands in segments of at most `longest` steps: longer ones are cut into parts of about equal length.

    Raises:
        ValueError: if `longest` is below 1.
    """
    if longest < 1:
        raise ValueError(f"longest must be at least 1 step, got {longest}.")
    n_parts = -(-segments.durations // longest)
    segment = np.repeat(np.arange(len(n_parts)), n_parts)
    part = np.arange(len(segment)) - np.repeat(np.cumsum(n_parts) - n_parts, n_parts)
    start, end = (k * segments.durations[segment] // n_parts[segment] for k in (part, part + 1))
    slopes = segments.slopes[segment]
    return Segments(slopes, segments.intercepts[segment] + slopes * start[:, None], end - start)


def clip_segments(segments: Segments, longest: int) -> Segments:
    """Each segment's first `longest` steps; errors as `cut_segments`."""
    if longest < 1:
        raise ValueError(f"longest must be at least 1 step, got {longest}.")
    return segments._replace(durations=np.minimum(segments.durations, longest))


def drop_segments(segments: Segments, longest: int) -> Segments:
    """The segments of at most `longest` steps; none may be left. Errors as `cut_segments`."""
    if longest < 1:
        raise ValueError(f"longest must be at least 1 step, got {longest}.")
    return Segments(*(field[segments.durations <= longest] for field in segments))


def join_segments(parts: list[Segments]) -> Segments:
    """The segments of several flows as one; raises `ValueError` when there is none."""
    if not parts:
        raise ValueError("no segments to join: at least one flow of commands is needed.")
    return Segments(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def segment(flows: Iterable[np.ndarray], settings: "ActionSettings") -> Segments:
    """The segments of several flows of commands, (T, E) each, by the method that the settings name.

    Raises:
        ValueError: if there is no flow, or one that `split_points` refuses.
    """
    method = SEGMENTATIONS[settings.segmentation]
    return join_segments([method(commands.T, settings) for commands in flows])


def _spaced(points: np.ndarray, shortest: int, n_steps: int) -> np.ndarray:
    """0, and those of the increasing `points` that leave `shortest` steps before and after them."""
    starts = [0]
    for point in points[points <= n_steps - shortest].tolist():
        if point >= starts[-1] + shortest:
            starts.append(point)
    return np.array(starts)


def _checked(commands: np.ndarray) -> np.ndarray:
    commands = np.asarray(commands, np.float64)
    if commands.ndim != 2 or not commands.size:
        raise ValueError(f"commands must be (effectors, steps), both at least 1, got shape {commands.shape}.")
    if not np.isfinite(commands).all():
        raise ValueError("commands must be finite: they hold NaN or infinite values.")
    return commands


def _second_derivative(commands: np.ndarray, settings: "ActionSettings") -> Segments:
    return linear_segments(commands, settings.min_duration)


def _hidden_markov(commands: np.ndarray, settings: "ActionSettings") -> Segments:
    return hidden_state_segments(commands, settings.n_actions, settings.min_duration)


SEGMENTATIONS: dict[str, Callable[[np.ndarray, "ActionSettings"], Segments]] = {
    "second_derivative": _second_derivative,
    "hidden_markov": _hidden_markov,
}
"""(commands (E, T), settings) -> segments of at least `min_duration` steps whose durations sum to T."""

LONG_SEGMENTS: dict[str, Callable[[Segments, int], Segments]] = {
    "cut": cut_segments,
    "clip": clip_segments,
    "drop": drop_segments,
}
"""(segments, longest) -> segments of at most `longest` steps."""
