"""The cells of the control experiments as folders, `ablations/TASK/EXPERIMENT/CONDITION/SEED` of a study.

A condition that several experiments have has its cells in the folder of the first of them (`conditions.places`).
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from qboot.envs.registry import canonical, get_task
from qboot.envs.task import Task
from qboot.study.controls.conditions import LAGS, Evolved, Place, conditions, is_shared, places
from qboot.study.controls.segments import in_words, recorded_number, segments_of, shortage
from qboot.study.store import files, provenance, runs
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.recipes import EQUIP, EXTRACT, LEARN_CELL
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings, RunSettings

# What a finished cell holds.
FILES = (*EQUIP.makes, *LEARN_CELL.makes)
Cell = Run[CellSettings]
Cells = dict[Cell, Run[RunSettings]]  # of one experiment, and the evolved run of each


class Plan(NamedTuple):
    """The cells that an experiment has to have, in their order."""

    cells: dict[Path, tuple[CellSettings, Run[RunSettings]]]  # by folder, and the evolved run of each
    left_out: list[str]  # conditions that cannot be had, and why, a line each


def begin(planned: Plan) -> Cells:
    """The cells of a plan, begun now or earlier, and the evolved run of each; what is left out is said on stderr.

    Raises:
        RunError: if a cell was begun with other settings or for fewer episodes, or all conditions are left out.
    """
    if not planned.cells:
        raise RunError("; ".join(planned.left_out))
    for line in planned.left_out:
        print(f"qboot: {line}", file=sys.stderr)
    for folder in planned.cells:
        _set_aside_damaged(folder)
    return {runs.create(folder, settings): run for folder, (settings, run) in planned.cells.items()}


def plan(
    study: Path,
    task_name: str,
    what: str,
    profile: str,
    n_runs: int,
    n_episodes: int,
    lanes: int,
    only: Sequence[str] = (),
) -> Plan:
    """The cells that an experiment has to have, begun or not.

    A number of actions for which one of the evolved runs has too few segments is left out: from the others alone it
    would be compared on other runs than the rest.

    Args:
        study: folder of the study, with finished runs of the task.
        task_name: as `qboot.envs.get_task` finds it.
        what: the experiment.
        profile: name of the profile, to be kept with the cells.
        n_runs: cells per condition, >= 1.
        n_episodes: of Q-learning, >= 1. A cell that serves another experiment too may have begun with more.
        lanes: learners side by side in a program, >= 1.
        only: names of the evolved runs that new cells start from, in turn; all, the sources in turn, if there is none.

    Raises:
        ValueError: for an unknown task or experiment, or a number below 1.
        RunError: if no run of the task has extracted actions and sensors, or not one that is named, one that cells were
            begun from is gone, or the runs' own number of actions is not the task's.
    """
    for name, value in (("runs", n_runs), ("episodes", n_episodes), ("lanes", lanes)):
        if value < 1:
            raise ValueError(f"{name} is {value}: at least 1 is needed")
    task = get_task(task_name)
    evolved = _evolved(study, task.name)
    by_name = {run.folder.name: run for run in evolved}
    if unknown := [name for name in only if name not in by_name]:
        raise RunError(
            f"{study} has no run {unknown[0]} of {task.name} with extracted actions and sensors: "
            f"choose some of {', '.join(by_name)}"
        )
    chosen = [by_name[name] for name in only] or evolved
    planned = Plan({}, [])
    for condition, place in places(task, what).items():
        of_condition = {}
        for seed in range(n_runs):
            folder = _folder(study, task.name, place) / str(seed)
            known = _known(folder)
            # A cell stays with its evolved run when there are more of them later.
            if known and known.evolved not in by_name:
                raise RunError(
                    f"{folder} was begun from the run {known.evolved}, which is gone: make it again, or delete both"
                )
            run = by_name[known.evolved] if known else chosen[seed % len(chosen)]
            actions = run.settings.actions
            if what == "n_actions" and place.what != what and actions.n_actions != int(condition):
                raise RunError(
                    f"{run.folder} has {actions.n_actions} extracted actions and not the task's {condition}, which the "
                    "others are compared with: use a study with the task's own number"
                )
            settings = CellSettings(
                task=canonical(task_name),
                source=run.settings.source,
                physics=run.settings.physics,
                seed=seed,
                profile=profile,
                n_steps=run.settings.n_steps,
                what=place.what,
                condition=place.condition,
                evolved=run.folder.name,
                actions=replace(actions, n_actions=int(condition)) if place.what == "n_actions" else actions,
                learner=run.settings.learner,
                episodes=_episodes(known, n_episodes, is_shared(task, place)),
                lanes=lanes,
            )
            _check_lags(settings, task)
            of_condition[folder] = settings, run
        if reason := _impossible(place, [run for _, run in of_condition.values()]):
            planned.left_out.append(f"{task.name} {what} {condition} is left out: {reason}")
        else:
            planned.cells.update(of_condition)
    return planned


def _impossible(place: Place, some: list[Run[RunSettings]]) -> str:
    """Why a condition cannot be had from all of the evolved runs that it starts from; empty if it can."""
    if place.what != "n_actions":
        return ""
    reasons = (shortage(run, int(place.condition)) for run in dict.fromkeys(some))
    return next(filter(None, reasons), "")


def _check_lags(settings: CellSettings, task: Task) -> None:
    """Refuse a learner that remembers less than inputs of the experiment need."""
    needed = LAGS if settings.what == "sensors" else 0
    if task.expert:
        needed = max(needed, len(task.expert.sensors))
    if needed > settings.learner.lags:
        raise ValueError(
            f"the experiment {settings.what} has inputs of {needed} past steps, but {settings.evolved} was begun with "
            f"learner.lags = {settings.learner.lags}: begin a run with --learner.lags {needed}"
        )


def is_finished(cell: Cell, evolved: Run[RunSettings]) -> bool:
    """Whether all of a cell is there, whole, and made from its evolved run as that is now."""
    return all(provenance.is_whole(cell, name, evolved) for name in FILES)


def find(study: Path, task_name: str, what: str) -> dict[str, list[Cell]]:
    """The finished cells of an experiment by condition; conditions without any are left out.

    Where there are only cells that another experiment has too, this one was not done.
    """
    found: dict[str, list[Cell]] = {}
    for condition, cell in _begun(study, task_name, what):
        if not isinstance(cell, str):
            found.setdefault(condition, []).append(cell)
    task = get_task(task_name)
    own = (name for name, place in places(task, what).items() if not is_shared(task, place))
    return found if any(name in found for name in own) else {}


def faults(study: Path, task_name: str, what: str) -> list[str]:
    """Why cells of an experiment are not among the finished ones, a line each: cells that were begun and are not whole,
    and conditions without any for which a run has too few segments.
    """
    words = []
    begun = set()
    for condition, cell in _begun(study, task_name, what):
        begun.add(condition)
        if isinstance(cell, str):
            words.append(cell)
    task = get_task(task_name)
    for condition, place in places(task, what).items():
        if place.what == "n_actions" and condition not in begun:
            for run in _extracted(runs.runs_below(study).runs, task.name):
                if (number := recorded_number(run)) < int(condition):
                    words.append(f"no cells of {what} {condition}: {in_words(run, int(condition), number)}")
    return words


def _begun(study: Path, task_name: str, what: str) -> Iterator[tuple[str, Cell | str]]:
    """Condition and cell, or why it is not a finished one, of all that were begun, in their order."""
    task = get_task(task_name)
    evolved = _readable(study, task.name)
    for condition, place in places(task, what).items():
        configs = _folder(study, task.name, place).glob("*/config.json")
        by_seed = (path.parent for path in configs if path.parent.name.isdecimal())
        for folder in sorted(by_seed, key=lambda folder: int(folder.name)):
            try:
                cell = runs.load(folder, CellSettings)
                provenance.require(cell, *FILES, evolved=evolved.get(cell.settings.evolved))
            except RunError as error:
                yield condition, str(error)
            else:
                yield condition, cell


def _readable(study: Path, task: str) -> dict[str, Run[RunSettings]]:
    """Runs of a task by name, as far as they can be read."""
    try:
        return {run.folder.name: run for run in runs.runs_below(study).runs if run.task_name == task}
    except RunError:  # none can
        return {}


def _known(folder: Path) -> CellSettings | None:
    """The settings of a cell that was begun; None for a new one, and for what cannot be read."""
    if not (folder / "config.json").exists():
        return None
    try:
        return runs.load(folder, CellSettings).settings
    except runs.Damaged:
        return None


def _set_aside_damaged(folder: Path) -> None:
    """Make room for the settings of a cell where there are some that cannot be read."""
    if (config := folder / "config.json").exists() and not _known(folder):
        files.set_aside(config, "is damaged")


def equip(cell: Cell, evolved: Run[RunSettings]) -> None:
    """Write what a cell learns with: actions.npz and sensors.npz, as the stage extract does for a run."""
    provenance.record_evolved(cell, evolved)
    output = Output(cell, EQUIP)
    if all(output.has(name) for name in EQUIP.makes):
        return
    provenance.set_aside_faulty(cell, EQUIP)
    settings = cell.settings
    condition = conditions(get_task(settings.task), settings.what)[settings.condition]
    origin = Evolved(evolved, lambda: segments_of(evolved))
    output.write_npz("actions.npz", files.to_arrays(condition.actions(settings, origin)))
    output.write_npz("sensors.npz", {"selected": condition.sensors(settings, origin)})


def folder_of(study: Path, task: str, what: str) -> Path:
    """Where the cells of an experiment are, CONDITION/SEED below it; `task` is its short name."""
    return study / "ablations" / task / what


def _folder(study: Path, task: str, place: Place) -> Path:
    return folder_of(study, task, place.what) / place.condition


def _episodes(known: CellSettings | None, wanted: int, is_shared: bool) -> int:
    """Episodes of a cell: as many as are wanted, or more where another experiment needs them."""
    return max(known.episodes, wanted) if known and is_shared else wanted


def _evolved(study: Path, task: str) -> list[Run[RunSettings]]:
    """Runs that actions and sensors were extracted from, the sources in turn."""
    ready = _extracted(runs.find(study), task)
    if not ready:
        raise RunError(
            f"{study} has no run of {task} with extracted actions and sensors: "
            f"make one with `qboot evolve --task TASK --out {study / task}/A-0` and `qboot extract` there"
        )
    return sorted(ready, key=lambda run: (run.settings.seed, run.settings.source))


def _extracted(some: list[Run[RunSettings]], task: str) -> list[Run[RunSettings]]:
    """Those of a task that actions and sensors were extracted from."""
    known = [run for run in some if run.task_name == task]
    return [run for run in known if all(provenance.is_whole(run, name) for name in EXTRACT.makes)]
