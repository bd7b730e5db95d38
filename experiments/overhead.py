"""What a generation, an episode and the start of a stage cost in two checkouts of the code, by turns.

    python experiments/overhead.py BEFORE [AFTER] --repeats 5

Each measurement is a command in a process of its own, and its seconds are those of all cores (user and system), so
that others may use the machine. A generation is the difference of two evolutions, an episode that of two learners, the
one over steps lived, the other over decisions, for the two checkouts need not draw the same random numbers. Compiled
programs are kept in a folder for the time of the measurement, and made before it begins.
"""

import argparse
import csv
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

FEW, MANY = 5, 45  # generations
SHORT, LONG = 1, 301  # episodes
SETTINGS = ["--task", "ball_collecting", "--profile", "smoke", "--n-steps", "1000", "--evolution.population", "32"]
# Of all rollouts at most: individuals, domains of the source set and timesteps; `lived` is the share that was lived.
STEPS_OF_GENERATION = 32 * 2 * 1000.0


def cpu_seconds(code: Path, programs: Path, *arguments: str) -> float:
    """Seconds of all cores that a command of a checkout takes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"PYTHONPATH": str(code), "JAX_COMPILATION_CACHE_DIR": str(programs)}
    command = [sys.executable, "-m", "qboot.cli", *arguments]
    subprocess.run(command, env=environment, cwd=code, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def column(path: Path, name: str) -> list[float]:
    """A column of numbers of a table."""
    with path.open() as stream:
        return [float(row[name]) for row in csv.DictReader(stream)]


def extracted(code: Path, programs: Path, scratch: Path) -> dict[int, Path]:
    """Runs from which short and long learners start, by their episodes."""
    found = {}
    for episodes in (SHORT, LONG):
        found[episodes] = scratch / f"extracted-{episodes}"
        begin = [*SETTINGS, "--episodes", str(episodes), "--evolution.generations", "3", "--out", str(found[episodes])]
        cpu_seconds(code, programs, "evolve", *begin)
        cpu_seconds(code, programs, "extract", "--out", str(found[episodes]))
    return found


def measure(code: Path, programs: Path, templates: dict[int, Path], scratch: Path) -> dict[str, float]:
    """Costs of one checkout, measured once."""
    evolved, lived, learned, decisions = {}, {}, {}, {}
    for generations in (FEW, MANY):
        run = scratch / f"evolved-{generations}"
        begin = [*SETTINGS, "--evolution.generations", str(generations), "--out", str(run)]
        evolved[generations] = cpu_seconds(code, programs, "evolve", *begin)
        lived[generations] = sum(column(run / "history.csv", "lived"))
    finished = cpu_seconds(code, programs, "evolve", "--out", str(scratch / f"evolved-{FEW}"))
    for episodes in (SHORT, LONG):
        run = scratch / f"learned-{episodes}"
        shutil.copytree(templates[episodes], run)
        learned[episodes] = cpu_seconds(code, programs, "learn", "--out", str(run))
        decisions[episodes] = sum(column(run / "qlearning.csv", "decisions"))
    return {
        "generation, ms": 1e3 * (evolved[MANY] - evolved[FEW]) / (MANY - FEW),
        "generation, ns a step lived": 1e9
        * (evolved[MANY] - evolved[FEW])
        / ((lived[MANY] - lived[FEW]) * STEPS_OF_GENERATION),
        "episode, ms": 1e3 * (learned[LONG] - learned[SHORT]) / (LONG - SHORT),
        "episode, us a decision": 1e6 * (learned[LONG] - learned[SHORT]) / (decisions[LONG] - decisions[SHORT]),
        "learn with one episode, s": learned[SHORT],
        "a stage that is done, s": finished,
    }


def main() -> int:
    """Measure, by turns, and print least and median of both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path, nargs="?", default=Path(__file__).parents[1])
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    codes = {"before": options.before.resolve(), "after": options.after.resolve()}
    found: dict[str, list[dict[str, float]]] = {name: [] for name in codes}
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        templates = {name: extracted(code, here / "programs", here / name) for name, code in codes.items()}
        for repeat in range(options.repeats + 1):
            for name, code in codes.items():
                scratch = here / f"{name}-{repeat}"
                costs = measure(code, here / "programs", templates[name], scratch)
                shutil.rmtree(scratch)
                if repeat:  # the first one compiles
                    found[name].append(costs)
                    print(name, ", ".join(f"{what} {value:.4g}" for what, value in costs.items()), flush=True)
    print(f"\n{'':30}{'before: least':>15}{'median':>10}{'after: least':>15}{'median':>10}{'after / before':>16}")
    for what in found["before"][0]:
        values = {name: [costs[what] for costs in of_code] for name, of_code in found.items()}
        row = [f(values[name]) for name in codes for f in (min, median)]
        print(f"{what:30}{row[0]:15.4g}{row[1]:10.4g}{row[2]:15.4g}{row[3]:10.4g}{row[2] / row[0]:16.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
