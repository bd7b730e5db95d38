"""The jobs of a study: the one table that `qboot reproduce`, its dry run and the workflow for clusters go by."""

import itertools
from pathlib import Path
from typing import NamedTuple

from qboot.envs.registry import BUILT_IN, canonical, get_task
from qboot.study.controls import cells
from qboot.study.controls.conditions import WHATS, Place, places
from qboot.study.controls.sweep import LANES
from qboot.study.pipeline import profiles
from qboot.study.pipeline.table import STAGES, Stage, stage
from qboot.study.store import runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

ABLATE = "ablate"
EVOLVED = ("lineage.npz", "actions.npz", "sensors.npz")  # of a run, from which learners start


class Job(NamedTuple):
    """One process of a study: a stage of a run, or a control experiment."""

    label: str  # for people: task, run or experiment, stage
    task: str  # as `qboot.envs.get_task` finds it
    profile: str
    step: str  # the stage, or "ablate"
    what: str  # SOURCE-SEED of a run, or the name of an experiment
    folder: Path  # of the run, or of the experiment
    arguments: tuple[str, ...]  # of `qboot`
    needs: tuple[Path, ...]  # files that other jobs make
    makes: tuple[Path, ...]  # in every study; a control experiment makes more where the evolved runs allow it
    is_parallel: bool  # whether it makes use of several workers
    run: RunSettings | None = None  # of a stage

    @property
    def task_name(self) -> str:
        """The short name of the task."""
        return get_task(self.task).name

    @property
    def is_done(self) -> bool:
        """Whether all that the job makes is there, whole, and made as it should be."""
        if self.run:
            return stage(self.step).is_done(Run(self.folder, self.run))
        return all(path.exists() for path in self.makes) and self._has_all_cells()

    def _has_all_cells(self) -> bool:
        """Whether all cells of a control experiment are finished that can be had from its evolved runs."""
        size = profiles.control_size_of(get_task(self.task), self.what, self.profile)
        study = self.folder.parents[2]
        try:
            planned = cells.plan(study, self.task, self.what, self.profile, size.runs, size.episodes, LANES)
        except RunError:  # no evolved runs, or none that go with what is there: `qboot ablate` says which
            return False
        return all(cells.is_finished(Run(folder, settings), run) for folder, (settings, run) in planned.cells.items())


def jobs_of(profile: str, task: str | None, out: Path, physics: str | None = None) -> list[Job]:
    """The jobs of a study in the folder `out`, each after those that it waits for.

    Args:
        profile: how large.
        task: one task as `qboot.envs.get_task` finds it; None for those of the paper.
        out: folder of the study.
        physics: what the one task runs on; None for what each is on record with.

    Raises:
        ValueError: for an unknown task, profile or physics, or a physics for several tasks.
    """
    if physics and not task:
        raise ValueError(f"--physics {physics} without --task: tasks differ in what they run on, so say which task")
    tasks = [canonical(task)] if task else list(BUILT_IN)
    settings = {name: profiles.runs_of(name, profile, physics) for name in tasks}
    # The tasks in turn: runs that start together compile different programs, and later ones find theirs in the store.
    in_turn = [run for some in itertools.zip_longest(*settings.values()) for run in some if run]
    of_runs = [_stage_job(out, run, stage) for run in in_turn for stage in STAGES]
    # Those of the slower simulation first, so that the cores are busy to the end.
    return of_runs + [_control_job(out, name, what, profile, settings[name]) for name in tasks[::-1] for what in WHATS]


def waits_for(job: Job, table: list[Job]) -> list[Job]:
    """The jobs of the table that make what a job needs."""
    return [other for other in table if not set(other.makes).isdisjoint(job.needs)]


def _stage_job(out: Path, run: RunSettings, stage: Stage) -> Job:
    name, folder = get_task(run.task).name, runs.folder_of(out, run)
    physics = () if run.physics == get_task(run.task).physics[0] else ("--physics", run.physics)
    begin = ("--task", run.task, "--profile", run.profile, "--source", run.source, "--seed", str(run.seed), *physics)
    return Job(
        label=f"{name} {folder.name} {stage.name}",
        task=run.task,
        profile=run.profile,
        step=stage.name,
        what=folder.name,
        folder=folder,
        # The first stage begins the run; the others find its settings in the folder.
        arguments=(stage.name, *(() if stage.needs else begin), "--out", str(folder)),
        needs=tuple(folder / file for file in stage.needs),
        makes=tuple(folder / file for file in stage.makes),
        is_parallel=stage.is_parallel,
        run=run,
    )


def _control_job(out: Path, task: str, what: str, profile: str, of_runs: list[RunSettings]) -> Job:
    """A control experiment; it needs the actions and sensors of all runs of its task, from which its learners start."""
    name, size = get_task(task).name, profiles.control_size_of(get_task(task), what, profile)
    of_places = {
        place: [cells.folder_of(out, name, place.what) / place.condition / str(seed) for seed in range(size.runs)]
        for place in places(get_task(task), what).values()
    }
    own = [
        folder for place, some in of_places.items() if place.what == what for folder in some if _is_certain(task, place)
    ]
    shared = [folder for place, some in of_places.items() if place.what != what for folder in some]
    return Job(
        label=f"{name} {what}",
        task=task,
        profile=profile,
        step=ABLATE,
        what=what,
        folder=cells.folder_of(out, name, what),
        arguments=(ABLATE, "--task", task, "--what", what, "--profile", profile, "--out", str(out)),
        needs=(
            *(runs.folder_of(out, run) / file for run in of_runs for file in EVOLVED),
            *(folder / "qlearning.csv" for folder in shared),  # cells that another experiment makes
        ),
        makes=tuple(folder / "qlearning.csv" for folder in own),
        is_parallel=True,
    )


def _is_certain(task: str, place: Place) -> bool:
    """Whether every evolved run can give a condition: as many actions as were extracted from it, or fewer."""
    return place.what != "n_actions" or int(place.condition) <= profiles.defaults_of(get_task(task)).actions.n_actions
