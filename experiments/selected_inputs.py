"""How many inputs the lasso keeps, by the rule that chooses its penalty.

    python experiments/selected_inputs.py docs/data/standard/ball_collecting/C-1 docs/data/standard/box_pushing/A-0

plays the lineages of runs again and prints a table in Markdown: a row per rule, a column per run.
"""

import argparse
import sys
from pathlib import Path

from qboot.extraction.sensors import SensorSettings, majority, sensor_votes
from qboot.study.pipeline.extracting import replayed
from qboot.study.store import runs
from qboot.study.store.files import RunError

RULES = {
    "BIC, as many observations as traces": SensorSettings(rule="bic_traces"),
    "BIC, 30,000 observations": SensorSettings(rule="bic", sample_size=30_000),
    "BIC, as many as rows": SensorSettings(rule="bic_rows"),
    **{f"fixed {alpha:g}": SensorSettings(rule="fixed", alpha=alpha) for alpha in (0.01, 0.003, 0.001, 0.0003, 0.0001)},
}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="run folders with a finished evolution")
    options = parser.parse_args()
    try:
        sources = [runs.load(folder) for folder in options.runs]
        flows = [[trace.observations for trace in replayed(run, workers=1)] for run in sources]
    except RunError as error:
        print(error, file=sys.stderr)
        return 2
    names = [
        f"{run.task_name} {run.folder.name}, {len(flow):,} traces" for run, flow in zip(sources, flows, strict=True)
    ]
    print(f"| rule | {' | '.join(names)} |\n|---{'|---' * len(names)}|")
    for name, settings in RULES.items():
        counts = [
            majority(sensor_votes(flow, run.settings.sensors.lags, settings).kept).sum()
            for run, flow in zip(sources, flows, strict=True)
        ]
        print(f"| {name} | {' | '.join(map(str, counts))} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
