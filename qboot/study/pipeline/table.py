"""The stages of a run, in their order: the one list that the command line, the runner and the report go by."""

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from qboot.study.store.recipes import EVOLVE, EXTRACT, LEARN, TRANSFER, Recipe

if TYPE_CHECKING:
    from qboot.study.store.output import Output
    from qboot.study.store.runs import Run
    from qboot.study.store.settings import RunSettings


class Stage(NamedTuple):
    """One stage: it reads and writes files of a run folder, skips what is done, resumes what was interrupted.

    What a stage makes depends on the run's settings alone, never on how often it was interrupted or how many workers
    it had.
    """

    recipe: Recipe  # what it makes and depends on
    help: str
    passing: tuple[str, ...]  # checkpoints, removed at the end
    is_parallel: bool  # whether it makes use of several workers
    function: str  # module:name of a (run, output, workers) -> None; imported when it is called

    @property
    def name(self) -> str:
        """Its command."""
        return self.recipe.step

    @property
    def needs(self) -> tuple[str, ...]:
        """The files of earlier stages that it reads."""
        return self.recipe.needs

    @property
    def makes(self) -> tuple[str, ...]:
        """The files that it makes; it is done when all of them are whole."""
        return self.recipe.makes

    def is_done(self, run: "Run[RunSettings]") -> bool:
        """Whether all that the stage makes is there, whole, and made with the settings and from the files of now."""
        from qboot.study.store import provenance

        return all(provenance.is_whole(run, name) for name in self.makes)

    def do(self, run: "Run[RunSettings]", workers: int = 1) -> None:
        """Do what is left of the stage.

        What lies in the place of its files and is not to be believed is set aside. What later stages made stays: it is
        used as long as this stage makes the same again, byte for byte, and counts as outdated otherwise.

        Raises:
            ValueError: for settings that cannot work.
            RunError: if a file that it needs is missing, damaged or outdated, or the folder is in use.
        """
        from qboot.study.pipeline.checks import check
        from qboot.study.store import files, lock, output, provenance

        if self.is_done(run) and not any(run.file(name).exists() for name in self.passing):
            return
        check(run.settings)
        with lock.owned(run.folder):
            if not self.is_done(run):
                provenance.require(run, *self.recipe.needs)
                provenance.set_aside_faulty(run, self.recipe)
                module, _, name = self.function.partition(":")
                work: Callable[[Run[RunSettings], Output, int], None] = getattr(importlib.import_module(module), name)
                work(run, output.Output(run, self.recipe), workers)
            for name in self.passing:
                files.remove(run.file(name))


_HERE = "qboot.study.pipeline"

STAGES = (
    Stage(
        EVOLVE,
        "neuro-evolution on the source set",
        passing=("evolve.checkpoint.npz",),
        is_parallel=True,
        function=f"{_HERE}.evolving:evolve_stage",
    ),
    Stage(
        EXTRACT,
        "actions and sensors from the lineage's traces",
        passing=(),
        is_parallel=True,
        function=f"{_HERE}.extracting:extract_stage",
    ),
    Stage(
        LEARN,
        "Q-learning on the source set with what was extracted",
        passing=("learn.checkpoint.npz",),
        is_parallel=False,
        function=f"{_HERE}.learning:learn_stage",
    ),
    Stage(
        TRANSFER,
        "new domains, without and with learning there",
        passing=("target_learn.checkpoint.npz", "target_er.checkpoint.npz", "target_er_transfer.checkpoint.npz"),
        is_parallel=True,
        function=f"{_HERE}.transferring:transfer_stage",
    ),
)


def stage(name: str) -> Stage:
    """The stage with a name; raises KeyError if there is none."""
    return {stage.name: stage for stage in STAGES}[name]
