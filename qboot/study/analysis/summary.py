"""A study of one task for a reader with a minute: what was done, what came out, how far to trust it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from qboot.study.analysis import sizes
from qboot.study.analysis.claims import Claim, counted
from qboot.study.analysis.control_measures import CellsByCondition
from qboot.study.analysis.curves import generalisation, moving_mean, source_curve, target_curve, top_score
from qboot.study.analysis.gathering import gather
from qboot.study.analysis.measures import WINDOW
from qboot.study.analysis.rules import MIN_RUNS
from qboot.study.analysis.words import as_number, count
from qboot.study.pipeline.table import STAGES, Stage
from qboot.study.store import provenance
from qboot.study.store.artifacts import task_of
from qboot.study.store.publishing import CONTENTS
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

Runs = list[Run[RunSettings]]  # of one task, at least one


class Summary(NamedTuple):
    """Sentences, in the order in which they are read."""

    done: list[str]
    found: list[str]
    trust: list[str]


def summary(cells: dict[str, CellsByCondition], some: Runs, answered: list[Claim]) -> Summary:
    """The summary of a study of one task.

    Args:
        cells: finished cells of each control experiment by its name.
        some: all runs of the task in the study.
        answered: the paper's claims.
    """
    return Summary(_done(cells, some), _found(some, answered), _trust(some))


def _done(cells: dict[str, CellsByCondition], some: Runs) -> list[str]:
    values = {row.label: " or ".join(f"{n:,}" for n in row.ours) for row in sizes.rows(some)}
    size = {name: values[label] for name, label in sizes.LABELS.items()}
    sources = sorted({run.settings.source for run in some})
    profiles = sorted({run.settings.profile for run in some})
    lines = [
        f"{count(len(some), 'run')} ({_listed('source set', sources)}; {_listed('profile', profiles)}): "
        f"{size['population']} networks evolve for {size['generations']} generations, then Q-learning for "
        f"{size['episodes']} episodes with the actions and sensors extracted from them; "
        f"rollouts of at most {size['n_steps']} timesteps."
    ]
    some_cells = {what.replace("n_", "number of "): found for what, found in cells.items() if found}
    if some_cells:
        learners = sorted({len(of_condition) for found in some_cells.values() for of_condition in found.values()})
        numbers = " or ".join(map(str, learners))
        lines.append(
            f"{count(len(some_cells), 'control experiment')} ({', '.join(some_cells)}), {numbers} "
            f"{'learner' if learners == [1] else 'learners'} per condition."
        )
    return lines


def _found(some: Runs, answered: list[Claim]) -> list[str]:
    source, target = (f"{top_score(some[0], which):g}" for which in ("source", "target"))
    sentences = {
        f"Source set, of {source}": {
            "evolution's best at the end": lambda run: source_curve(run, "ER").scores[-1],
            f"Q-learning, mean of the last {WINDOW} episodes": _level(source_curve),
        },
        f"New domains without learning there, of {target}": {
            "the network": lambda run: generalisation(run, "ER"),
            "the Q-policy": lambda run: generalisation(run, "QL"),
        },
        f"New domains after learning there, of {target}": {
            "Q-learning": _level(target_curve),
            "evolution": lambda run: target_curve(run, "ER").scores[-1],
            "evolution from the source's front": lambda run: target_curve(run, "ER+transfer").scores[-1],
        },
    }
    lines = []
    for where, reads in sentences.items():
        told = {who: _told(some, read) for who, read in reads.items()}
        if any(told.values()):
            lines.append(f"{where}: {'; '.join(f'{who} {words}' for who, words in told.items() if words)}.")
    if answered:
        lines.append(counted(answered))
    return lines or ["Nothing yet."]


def _trust(some: Runs) -> list[str]:
    task, n, rows = task_of(some[0]), len(some), sizes.rows(some)
    lines = []
    if n < MIN_RUNS:
        lines.append(f"{count(n, 'run')}: chance alone can make such differences, at least {MIN_RUNS} are compared.")
    if reduced := sum(row.is_reduced for row in rows):
        lines.append(
            f"The sizes of this study are reduced: {reduced} of {len(rows)} {_are(reduced)} below the paper's, "
            "therefore many of the numbers cannot be compared with the paper's. They show that every step works, and "
            "where it leads."
        )
    lacking: dict[tuple[str, ...], list[str]] = {}
    for run in some:
        if names := tuple(stage.name for stage in STAGES if not has_numbers(run, stage)):
            lacking.setdefault(names, []).append(run.folder.name)
    if n_lacking := sum(map(len, lacking.values())):
        which = "; ".join(f"{', '.join(names)} in {', '.join(runs)}" for names, runs in lacking.items())
        lines.append(f"{n_lacking} of {count(n, 'run')} {_are(n_lacking)} not complete. Missing: {which}.")
    other = sorted({run.settings.physics for run in some} - {task.physics[0]})
    if other:
        lines.append(f"Physics {', '.join(other)}, not that of record ({task.physics[0]}).")
    return lines or [f"{count(n, 'run')}, all complete."]


def has_numbers(run: Run[RunSettings], stage: Stage) -> bool:
    """Whether all is there that numbers are read from; Q-networks are left out when a study is published."""
    return all(provenance.is_whole(run, name) for name in stage.makes if name in CONTENTS)


def _level(read: Callable) -> Callable[[Run[RunSettings]], float]:
    return lambda run: moving_mean(read(run, "QL"), WINDOW).scores[-1]


def _told(some: Runs, read: Callable[[Run[RunSettings]], float]) -> str:
    """Median, range and number of what runs have; empty where none has it."""
    values = list(map(float, gather(some, read).found.values()))
    if not values:
        return ""
    if len(values) == 1:
        return as_number(values[0])
    low, high = as_number(min(values)), as_number(max(values))
    return f"{as_number(float(np.median(values)))} (median of {len(values)}, {low} to {high})"


def _are(n: int) -> str:
    return "is" if n == 1 else "are"


def _listed(noun: str, names: list[str]) -> str:
    return f"{noun if len(names) == 1 else noun + 's'} {', '.join(names)}"
