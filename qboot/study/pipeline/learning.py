"""Q-learning in progress: the learner with its history, saved together, and the calls that are left."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.qlearning.learner import EpisodeInfo, LearnerState
from qboot.study.store import files

SECONDS_BETWEEN_SAVES = 20.0
# Episodes per compiled call; what is done of it is lost when a stage is killed.
EPISODES_PER_CALL = 10
COLUMNS = ("episode", "score", "discounted_return", "steps", "decisions", "td_error", "largest_q")


class Learning(NamedTuple):
    """A learner and what it has been through."""

    state: LearnerState
    history: dict[str, list]  # COLUMNS of qlearning.csv; scores summed over the domains


def begin(state: LearnerState, checkpoint: Path) -> Learning:
    """A learner from its first `state`, or from where the checkpoint, if there is one, says."""
    if not checkpoint.exists():
        return Learning(state, {name: [] for name in COLUMNS})
    arrays = files.read_npz(checkpoint)
    history = {name: arrays[f"history.{name}"].tolist() for name in COLUMNS}
    return Learning(files.from_arrays(arrays, state, checkpoint), history)


def save(learning: Learning, checkpoint: Path) -> None:
    """Write a checkpoint."""
    history = {f"history.{name}": np.array(values) for name, values in learning.history.items()}
    files.write_npz(checkpoint, files.to_arrays(learning.state) | history)


def after(learning: Learning, state: LearnerState, info: EpisodeInfo) -> Learning:
    """The learner after a call that returned `state` and `info` (one entry per episode)."""
    names = COLUMNS[1:5]
    sums = {name: np.asarray(getattr(info, name)).sum(axis=1).tolist() for name in names}
    first, n = len(learning.history["episode"]) + 1, len(info.td_error)
    new = {
        "episode": list(range(first, first + n)),
        **sums,
        "td_error": np.asarray(info.td_error).tolist(),
        "largest_q": np.asarray(info.largest_q).tolist(),
    }
    return Learning(state, {name: learning.history[name] + new[name] for name in COLUMNS})


def call_sizes(done: int, n_episodes: int) -> Iterator[int]:
    """Sizes of the calls that are left; they start at multiples of the usual size, so few sizes are compiled."""
    while done < n_episodes:
        size = min(EPISODES_PER_CALL, n_episodes - done)
        yield size
        done += size
