"""Commands that the evolved networks of runs give and no extracted action does.

    python experiments/lost_commands.py results/standard ball_collecting

The traces of each run are played again; runs whose networks score otherwise on this machine are named and left out.
Printed is a table in Markdown: for each side of an effector (above or below the middle of its range) that some run uses
in less than a tenth of its steps, in what share of the steps of the traces the command is there, for how many steps in
a row in the median, in what share of the segments, and in how many actions; then the mean score of the last hundred
episodes of Q-learning.
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.extraction.lost_commands import MIDDLE, Use, is_on, on_side, uses
from qboot.extraction.segmentation import LONG_SEGMENTS
from qboot.study.analysis.curves import score_at_the_end, source_curve
from qboot.study.pipeline.extracting import replayed, segments_of
from qboot.study.store import runs
from qboot.study.store.artifacts import read_actions, task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

RARE = 0.1  # share of the steps


class Lost(NamedTuple):
    """How often a run's commands are on one side of one effector."""

    use: Use
    of_segments: float  # share of those that were clustered
    in_a_row: float  # steps, in the median; 0 where it is never there


def uses_of(run: Run[RunSettings]) -> dict[tuple[str, str], Lost]:
    """The use of each side of each effector in the traces, the segments and the actions of a run."""
    traces, settings, effectors = replayed(run, workers=1), run.settings.actions, task_of(run).effectors
    segments = LONG_SEGMENTS[settings.long_segments](segments_of(run, traces), settings.max_duration)
    found = uses(np.concatenate([trace.commands for trace in traces]), read_actions(run), effectors)
    return {
        (name, side): Lost(
            use,
            float(on_side(segments, effectors.index(name), side).mean()),
            in_a_row([trace.commands[:, effectors.index(name)] for trace in traces], side),
        )
        for (name, side), use in found.items()
    }


def in_a_row(commands: list[np.ndarray], side: str) -> float:
    """Median number of steps for which commands stay on one side once they are there; 0 where they never are."""
    lengths = []
    for of_trace in commands:
        is_there = is_on(of_trace, side).astype(int)
        begins, ends = (np.flatnonzero(np.diff(np.pad(is_there, 1)) == change) for change in (1, -1))
        lengths.append(ends - begins)
    found = np.concatenate(lengths)
    return float(np.median(found)) if len(found) else 0.0


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
    found = {}
    for run in learned:
        try:
            found[run] = uses_of(run)
        except RunError as error:  # a lineage from elsewhere may replay to other scores
            print(error, file=sys.stderr)
    if not found:
        return 2
    first = next(iter(found.values()))
    least = {name: min(of_run[name].use.of_steps for of_run in found.values()) for name in first}
    rare = [name for name, share in least.items() if share < RARE]
    print(
        "| run |",
        " | ".join(f"{name} {side} {MIDDLE:g}: steps, in a row, segments, actions" for name, side in rare),
        "| QL mean of last 100 |",
    )
    print("|---" * (len(rare) + 2) + "|")
    for run, of_run in found.items():
        shown = (of_run[name] for name in rare)
        cells = [
            f"{each.use.of_steps:.2%}, {each.in_a_row:g}, {each.of_segments:.2%}, {each.use.of_actions}"
            for each in shown
        ]
        print(
            f"| {run.folder.name} |",
            " | ".join(cells),
            f"| {score_at_the_end(source_curve(run, 'QL').scores):.2f} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
