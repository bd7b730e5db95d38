"""`make bench` in two checkouts of the code, by turns: what both measure, side by side.

    python experiments/bench_beside.py BEFORE [AFTER] [--pattern q_learning] --repeats 2

Each benchmark is a process of its own, one after another, so let nothing else run. Compile times are left out, and
benchmarks that do not tell one time: of the machine itself, of the parts of an episode, and sweeps of learners, which
the checkouts may measure with other stores.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

# Under these names a benchmark tells its seconds, or how much it does in one.
SECONDS = ("s", "median_s", "s_per_episode")
RATES = ("steps_per_second",)
LEFT_OUT = ("machine", "episode", "sweep")  # words in the names of those that do not tell one time
NAMES = "import runpy; print(*runpy.run_path('experiments/bench.py')['BENCHMARKS'], sep='\\n')"


def python(code: Path, *arguments: str) -> str:
    """What Python prints that runs in a checkout."""
    command = [sys.executable, *arguments]
    environment = os.environ | {"PYTHONPATH": str(code)}
    return subprocess.run(command, env=environment, cwd=code, check=True, stdout=subprocess.PIPE, text=True).stdout


def measured(code: Path, name: str) -> float:
    """Seconds, or seconds of a step, of one benchmark; NaN where it tells neither."""
    with tempfile.NamedTemporaryFile() as stream:
        python(code, "experiments/bench.py", name, "--out", stream.name)
        rows = [json.loads(line) for line in Path(stream.name).read_text().splitlines()]
    [row] = [row for row in rows if row["benchmark"] == name]  # longer names that contain it were run, too
    seconds = [row[key] for key in SECONDS if key in row] + [1.0 / row[key] for key in RATES if key in row]
    return seconds[0] if seconds else math.nan


def main() -> int:
    """Measure, by turns, and print the least of both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path, nargs="?", default=Path(__file__).parents[1])
    parser.add_argument("--pattern", default="", help="the benchmarks with this in their name; default all")
    parser.add_argument("--repeats", type=int, default=2)
    options = parser.parse_args()
    codes = [options.before.resolve(), options.after.resolve()]
    there = [python(code, "-c", NAMES).splitlines() for code in codes]
    print(f"{'':54}{'before':>12}{'after':>12}{'after / before':>16}")
    for name in there[0]:
        if options.pattern not in name or name not in there[1] or any(word in name for word in LEFT_OUT):
            continue
        turns = [[measured(code, name) for code in codes] for _ in range(options.repeats)]
        before, after = (min(of_code) for of_code in zip(*turns, strict=True))
        print(f"{name:54}{before:12.3g}{after:12.3g}{after / before:16.2f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
