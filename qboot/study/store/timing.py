"""Wall time, as the runner notes it beside what was made: timing.csv, `step,seconds` a line, one per start."""

import contextlib
from pathlib import Path


def seconds_by_step(folder: Path) -> dict[str, float]:
    """Wall time by step of a run or an experiment: sums over starts; nothing where none was noted."""
    total: dict[str, float] = {}
    path = folder / "timing.csv"
    for line in path.read_text().splitlines() if path.exists() else ():
        step, _, seconds = line.partition(",")
        with contextlib.suppress(ValueError):  # a line that was cut off
            total[step] = total.get(step, 0.0) + float(seconds)
    return total
