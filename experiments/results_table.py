"""A table per task of a results folder, one line per run, in Markdown.

python experiments/results_table.py RESULTS_FOLDER
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np

from qboot.study import files
from qboot.study.curves import runs_below
from qboot.study.files import RunError
from qboot.study.runs import Run

# Scores whose first time is given: two of evolution, one of Q-learning.
GOALS = {"ball_collecting": (7, 8, 6), "box_pushing": (13, 15, 13)}


def header(task: str) -> list[str]:
    """The columns of a task's table."""
    high, top, learned = GOALS[task]
    return [
        "run", f"generations to {high}", f"to {top}", "last best", "lineage", "segments", "durations", "inputs",
        "QL best", f"episodes to {learned}", "QL mean of last 100", "ER on new domains", "QL on new domains",
    ]  # fmt: skip


def first_at_least(values: list[str], score: float, positions: list[str]) -> str:
    """The position at which a value first reaches a score, or a dash."""
    reached = [position for value, position in zip(values, positions, strict=True) if float(value) >= score]
    return reached[0] if reached else "-"


def row(run: Run) -> list[str]:
    """The cells of a run; stages that were not done leave dashes."""
    high, top, learned = GOALS[run.settings.task]
    history = files.read_csv(run.file("history.csv"))
    cells = [
        f"{run.settings.source}-{run.settings.seed}",
        first_at_least(history["best"], high, history["generation"]),
        first_at_least(history["best"], top, history["generation"]),
        f"{float(history['best'][-1]):g}",
        str(len(files.read_npz(run.file("lineage.npz"))["ids"])),
    ]
    if run.file("sensors.npz").exists():
        actions = files.read_npz(run.file("actions.npz"))
        durations = np.percentile(actions["durations"], [25, 50, 75])
        cells += [f"{int(actions['n_segments']):,}", ", ".join(f"{d:g}" for d in durations)]
        cells.append(str(int(files.read_npz(run.file("sensors.npz"))["selected"].sum())))
    if run.file("qnets.npz").exists():
        learning = files.read_csv(run.file("qlearning.csv"))
        scores = np.array(learning["score"], float)
        cells += [f"{scores.max():g}", first_at_least(learning["score"], learned, learning["episode"])]
        cells.append(f"{scores[-100:].mean():.2f}")
    if run.file("generalisation.csv").exists():
        found = files.read_csv(run.file("generalisation.csv"))
        for method in ("ER", "QL"):
            values = [float(s) for s, m in zip(found["score"], found["method"], strict=True) if m == method]
            cells.append(f"{sum(values):g}")
    return cells + ["-"] * (len(header(run.settings.task)) - len(cells))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="folder of a study")
    try:
        tables = [
            [header(task), ["---"] * len(header(task)), *(row(run) for run in some)]
            for task, some in itertools.groupby(
                runs_below(parser.parse_args().results), key=lambda run: run.settings.task
            )
        ]
    except RunError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n\n".join("\n".join(f"| {' | '.join(cells)} |" for cells in table) for table in tables))
    return 0


if __name__ == "__main__":
    sys.exit(main())
