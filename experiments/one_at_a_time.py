"""What each choice in extraction and learning does: change one at a time, on the lineages of finished runs.

    python experiments/one_at_a_time.py results/one_at_a_time results/standard/ball_collecting/A-? --learners 3
    python experiments/one_at_a_time.py results/long_segments results/arm/box_pushing/A-? --only "long segments"

prints a line of Markdown per variant: the mean score of the last 100 episodes, as a mean over learners with a 95 %
bootstrap interval over runs; the best episode among the last 100, likewise; and how many learners failed, that is, had
no episode with a third of the top score among the last 100. A learner is one seed; all variants have the same ones.
Finished learners are not run again. The runs must be of one task, and evolved by this version of qboot.
"""

import argparse
import dataclasses
import shutil
import sys
from pathlib import Path

import numpy as np
from scipy import stats

from qboot.study.analysis.curves import top_score
from qboot.study.pipeline import table
from qboot.study.store import files, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Name, room of the settings, changes; the first changes nothing.
VARIANTS = (
    ("as it is", None, {}),
    ("learning rate 0.003", "learner", {"alpha": 0.003}),
    ("learning rate 0.01", "learner", {"alpha": 0.01}),
    ("lags count steps", "learner", {"history": "steps"}),
    ("no replay", "learner", {"eta": 0}),
    ("lasso: BIC of 30,000 observations", "sensors", {"rule": "bic"}),
    ("lasso fitted on decisions", "sensors", {"moments": "decisions"}),
    ("split points as printed", "actions", {"min_duration": 1}),
    ("uncut long segments", "actions", {"max_duration": 100_000}),
    ("long segments cut", "actions", {"long_segments": "cut"}),
    ("long segments clipped", "actions", {"long_segments": "clip"}),
    ("long segments dropped", "actions", {"long_segments": "drop"}),
    ("durations in steps", "actions", {"duration_unit": 1.0}),
    ("features standardised", "actions", {"scale": "std"}),
    ("features scaled to [0, 1]", "actions", {"scale": "minmax"}),
    ("fuzziness 2", "actions", {"fuzziness": 2.0}),
    (
        "as printed: features in [0, 1], fuzziness 2, no limits on durations",
        "actions",
        {"scale": "minmax", "fuzziness": 2.0, "min_duration": 1, "max_duration": 100_000},
    ),
)
LAST = 100
FAILED_BELOW = 1 / 3  # of the top score


def changed(settings: RunSettings, room: str | None, change: dict, episodes: int) -> RunSettings:
    """Settings with one change, and as many episodes as asked."""
    if room is not None:
        settings = dataclasses.replace(settings, **{room: dataclasses.replace(getattr(settings, room), **change)})
    return dataclasses.replace(settings, episodes=episodes)


def scores_of(source: Run, folder: Path, settings: RunSettings, learners: int) -> np.ndarray:
    """Scores (learners, episodes) of Q-learning on the lineage of `source` with other settings."""
    run = runs.create(folder, settings)
    copy(source, run, "history.csv", "lineage.npz", "pareto.npz")
    table.stage("extract").do(run)
    found = []
    for seed in range(learners):
        learner = runs.create(folder / f"learner-{seed}", dataclasses.replace(settings, seed=seed))
        copy(run, learner, "actions.npz", "sensors.npz")
        table.stage("learn").do(learner)
        found.append(np.array(files.read_csv(learner.file("qlearning.csv"))["score"], float))
    return np.array(found)


def copy(source: Run, target: Run, *names: str) -> None:
    """Give a run the files of another one."""
    for name in names:
        if not provenance.is_whole(target, name):
            provenance.require(source, name)
            shutil.copy(source.file(name), target.file(name))
            provenance.record(target, name, files.digest(target.file(name)))


def with_interval(values: np.ndarray) -> str:
    """Mean of (runs, learners) and its 95 % bootstrap interval over runs."""
    of_runs = values.mean(axis=1)
    if len(of_runs) < 2:
        return f"{of_runs.mean():.2f}"
    interval = stats.bootstrap((of_runs,), np.mean, method="percentile", rng=0).confidence_interval
    return f"{of_runs.mean():.2f} [{interval.low:.2f}, {interval.high:.2f}]"


def line(name: str, scores: np.ndarray, top: float) -> str:
    """The line of a variant with scores (runs, learners, episodes)."""
    last = scores[..., -LAST:]
    best = last.max(axis=-1)
    failed = int((best < FAILED_BELOW * top).sum())
    return f"| {name} | {with_interval(last.mean(axis=-1))} | {with_interval(best)} | {failed} of {best.size} |"


def main() -> int:
    """Run the variants, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder for the variants")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="run folders with a finished evolution")
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--learners", type=int, default=1, help="for each run and variant")
    parser.add_argument("--only", default="", help="variants whose names begin so")
    options = parser.parse_args()
    print("| changed | mean of the last 100 | best of the last 100 | failed |\n|---|---|---|---|", flush=True)
    try:
        sources = [runs.load(folder) for folder in options.runs]
        top = top_score(sources[0], "source")
        for name, room, change in VARIANTS:
            if not name.startswith(options.only):
                continue
            short = "".join(letter if letter.isalnum() else "_" for letter in name)
            scores = [
                scores_of(
                    source,
                    options.out / short / source.folder.name,
                    changed(source.settings, room, change, options.episodes),
                    options.learners,
                )
                for source in sources
            ]
            print(line(name, np.array(scores), top), flush=True)
    except (RunError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
