"""Commands that the evolved networks of runs give and no extracted action does.

    python experiments/lost_commands.py results/standard ball_collecting

A side of an effector is the half of its range below or above the middle, as the Hamming distance sees it: for the crane
of ball collecting, below lets go and above holds. The traces of each run are played again. Printed are, as a table in
Markdown and for each side that a run uses in less than a tenth of its steps: in what share of the steps of the
traces and of their segments the command is on that side, and in how many actions, at their first or last step; then
the mean score of the last hundred episodes of Q-learning. What only a command on a lost side can do cannot be learned.
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.extraction.actions import ActionSet
from qboot.extraction.segmentation import LONG_SEGMENTS, Segments
from qboot.extraction.traces import Trace
from qboot.study.pipeline.extracting import replayed, segments_of
from qboot.study.store import runs
from qboot.study.store.artifacts import read_actions, read_columns, task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

SIDES = ("below", "above")
RARE = 0.1


class Use(NamedTuple):
    """How often commands are on one side of one effector."""

    of_steps: float  # share
    of_segments: float  # share
    of_actions: int


def on_side(linear: ActionSet | Segments, effector: int, side: str) -> np.ndarray:
    """Which linear commands (n,) are on a side of an effector at their first or last step."""
    first = np.asarray(linear.intercepts)[:, effector]
    last = first + np.asarray(linear.slopes)[:, effector] * (np.asarray(linear.durations) - 1)
    return np.minimum(first, last) < 0.5 if side == "below" else np.maximum(first, last) >= 0.5


def uses(traces: list[Trace], segments: Segments, actions: ActionSet, effectors: tuple[str, ...]) -> dict[str, Use]:
    """The use of each side of each effector, by a name for people."""
    commands = np.concatenate([trace.commands for trace in traces])
    return {
        f"{effector} {side} 0.5": Use(
            of_steps=float(((commands[:, i] < 0.5) == (side == "below")).mean()),
            of_segments=float(on_side(segments, i, side).mean()),
            of_actions=int(on_side(actions, i, side).sum()),
        )
        for i, effector in enumerate(effectors)
        for side in SIDES
    }


def uses_of(run: Run[RunSettings]) -> dict[str, Use]:
    """The same of a run, whose segments are those that were clustered."""
    traces, settings = replayed(run, workers=1), run.settings.actions
    segments = LONG_SEGMENTS[settings.long_segments](segments_of(run, traces), settings.max_duration)
    return uses(traces, segments, read_actions(run), task_of(run).effectors)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path)
    parser.add_argument("task")
    options = parser.parse_args()
    some = [run for run in runs.find(options.study) if run.task_name == options.task]
    learned = [run for run in some if run.file("qlearning.csv").exists()]
    if not learned:
        parser.error(f"{options.study} has no run of {options.task} that has learned")
    found = {run: uses_of(run) for run in learned}
    least = {name: min(of_run[name].of_steps for of_run in found.values()) for name in found[learned[0]]}
    rare = [name for name, share in least.items() if share < RARE]
    print("| run |", " | ".join(f"{name}: steps, segments, actions" for name in rare), "| QL mean of last 100 |")
    print("|---" * (len(rare) + 2) + "|")
    for run, of_run in found.items():
        shown = (of_run[name] for name in rare)
        cells = [f"{use.of_steps:.2%}, {use.of_segments:.2%}, {use.of_actions}" for use in shown]
        scores = [float(score) for score in read_columns(run, "qlearning.csv")["score"][-100:]]
        print(f"| {run.folder.name} |", " | ".join(cells), f"| {np.mean(scores):.2f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
