"""The stages of a run, in their order: the one list that the command line, the runner and the report go by."""

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from qboot.study.store.runs import Run
    from qboot.study.store.settings import RunSettings


class Stage(NamedTuple):
    """One stage: it reads and writes files of a run folder, skips what is done, resumes what was interrupted.

    What a stage makes depends on the run's settings alone, never on how often it was interrupted or how many workers
    it had.
    """

    name: str
    help: str
    needs: tuple[str, ...]  # files of earlier stages
    makes: tuple[str, ...]  # files; it is done when all of them are there
    passing: tuple[str, ...]  # checkpoints, removed at the end
    is_parallel: bool  # whether it makes use of several workers
    function: str  # module:name of a (run, workers) -> None; imported when it is called

    def is_done(self, run: "Run[RunSettings]") -> bool:
        """Whether all that the stage makes is there."""
        return all(run.file(name).exists() for name in self.makes)

    def do(self, run: "Run[RunSettings]", workers: int = 1) -> None:
        """Do what is left of the stage.

        What later stages made of an earlier result is removed first: it would stand beside the new one.

        Raises:
            RunError: if a file that it needs is missing or damaged.
        """
        if self.is_done(run):
            return
        for name in self.needs:
            run.require(name)
        for later in STAGES[STAGES.index(self) + 1 :]:
            for name in (*later.makes, *later.passing):
                run.file(name).unlink(missing_ok=True)
        module, _, name = self.function.partition(":")
        work: Callable[[Run[RunSettings], int], None] = getattr(importlib.import_module(module), name)
        work(run, workers)
        for name in self.passing:
            run.file(name).unlink(missing_ok=True)


_HERE = "qboot.study.pipeline"

STAGES = (
    Stage(
        "evolve",
        "neuro-evolution on the source set",
        needs=(),
        makes=("history.csv", "lineage.npz", "pareto.npz"),
        passing=("evolve.checkpoint.npz",),
        is_parallel=True,
        function=f"{_HERE}.evolving:evolve_stage",
    ),
    Stage(
        "extract",
        "actions and sensors from the lineage's traces",
        needs=("lineage.npz",),
        makes=("actions.npz", "sensors.npz"),
        passing=(),
        is_parallel=True,
        function=f"{_HERE}.extracting:extract_stage",
    ),
    Stage(
        "learn",
        "Q-learning on the source set with what was extracted",
        needs=("actions.npz", "sensors.npz"),
        makes=("qlearning.csv", "qnets.npz"),
        passing=("learn.checkpoint.npz",),
        is_parallel=False,
        function=f"{_HERE}.learning:learn_stage",
    ),
    Stage(
        "transfer",
        "new domains, without and with learning there",
        needs=("lineage.npz", "pareto.npz", "actions.npz", "sensors.npz", "qnets.npz"),
        makes=("generalisation.csv", "target_learn.csv", "target_er.csv", "target_er_transfer.csv", "transfer.csv"),
        passing=("target_learn.checkpoint.npz", "target_er.checkpoint.npz", "target_er_transfer.checkpoint.npz"),
        is_parallel=True,
        function=f"{_HERE}.transferring:transfer_stage",
    ),
)


def stage(name: str) -> Stage:
    """The stage with a name; raises KeyError if there is none."""
    return {stage.name: stage for stage in STAGES}[name]
