"""What each choice in extraction and learning does: change one at a time, on the lineage of a finished run.

    python experiments/one_at_a_time.py results/standard/ball_collecting/A-1 results/one_at_a_time --episodes 500

prints a line of Markdown per variant: the mean score of the last 100 episodes and the best one.
"""

import argparse
import dataclasses
import shutil
import sys
from pathlib import Path

import numpy as np

from qboot.study.pipeline import table
from qboot.study.store import files, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Room of the settings, setting, value; the first line changes nothing.
VARIANTS = (
    ("as it is", None, {}),
    ("learning rate 0.003", "learner", {"alpha": 0.003}),
    ("learning rate 0.01", "learner", {"alpha": 0.01}),
    ("lags count steps", "learner", {"history": "steps"}),
    ("no replay", "learner", {"eta": 0}),
    ("lasso: BIC of 30,000 observations", "sensors", {"rule": "bic"}),
    ("split points as printed", "actions", {"min_duration": 1}),
    ("long segments uncut", "actions", {"max_duration": 100_000}),
    ("durations in steps", "actions", {"duration_unit": 1.0}),
    ("features standardised", "actions", {"scale": "std"}),
    ("features scaled to [0, 1]", "actions", {"scale": "minmax"}),
    ("fuzziness 2", "actions", {"fuzziness": 2.0}),
)


def changed(settings: RunSettings, room: str | None, change: dict, episodes: int) -> RunSettings:
    """Settings with one change, and as many episodes as asked."""
    if room is not None:
        settings = dataclasses.replace(settings, **{room: dataclasses.replace(getattr(settings, room), **change)})
    return dataclasses.replace(settings, episodes=episodes)


def variant(source: Run, folder: Path, settings: RunSettings) -> np.ndarray:
    """Scores (episodes,) of Q-learning on the lineage of `source` with other settings."""
    run = runs.create(folder, settings)
    for name in ("history.csv", "lineage.npz", "pareto.npz"):
        if not provenance.is_whole(run, name):
            provenance.require(source, name)
            shutil.copy(source.file(name), run.file(name))
            provenance.record(run, name, files.digest(run.file(name)))
    for stage in ("extract", "learn"):
        table.stage(stage).do(run)
    return np.array(files.read_csv(run.file("qlearning.csv"))["score"], float)


def main() -> int:
    """Run all variants, one after the other; finished ones are not run again."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="a run folder with a finished evolution")
    parser.add_argument("out", type=Path, help="folder for the variants")
    parser.add_argument("--episodes", type=int, default=500)
    options = parser.parse_args()
    print("| changed | mean of the last 100 | best |\n|---|---|---|", flush=True)
    try:
        source = runs.load(options.run)
        for name, room, change in VARIANTS:
            settings = changed(source.settings, room, change, options.episodes)
            folder = options.out / name.replace(" ", "_").replace(",", "").replace(":", "")
            scores = variant(source, folder, settings)
            print(f"| {name} | {scores[-100:].mean():.2f} | {scores.max():g} |", flush=True)
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
