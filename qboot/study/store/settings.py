"""Every setting of a run; frozen, so that a configuration read back is the one that was written."""

from dataclasses import dataclass

from tyro.conf import Suppress

from qboot.extraction.actions import ActionSettings
from qboot.extraction.sensors import SensorSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.qlearning.settings import LearnerSettings


@dataclass(frozen=True)
class RunSettings:
    """Every setting of a run; the defaults of a task and a profile come from `qboot.study.pipeline.profiles`."""

    # Suppressed in the list of settings that tyro prints: the command line has options of its own for them.

    task: Suppress[str]
    """Registered name, package.module:TASK or path/to/file.py:TASK."""
    source: Suppress[str]
    """Name of the source domain set."""
    physics: str
    """What the task runs on; the first of its kinds is the one of record."""
    seed: Suppress[int]
    """Everything random comes from it."""
    profile: Suppress[str]
    """Name of the profile that the sizes come from."""
    n_steps: int
    """Steps of one rollout at most."""
    dnn: DnnSettings
    evolution: EvolutionSettings
    actions: ActionSettings
    sensors: SensorSettings
    learner: LearnerSettings
    episodes: int
    """Q-learning episodes on the source set."""
    target_episodes: int
    """Q-learning episodes on the target set."""
    target_generations: int
    """Generations of ER and of ER + transfer on the target set."""

    def __post_init__(self):
        """Reject sizes that make no run."""
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed is {self.seed}: it must lie between 0 and {2**32 - 1}")
        for name, least in (("n_steps", 1), ("episodes", 1), ("target_episodes", 1), ("target_generations", 0)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least {least}")


@dataclass(frozen=True)
class CellSettings:
    """Every setting of one learner of a control experiment; a name that `RunSettings` has too means the same."""

    task: str
    source: str
    physics: str
    seed: int
    """Which learner of its condition: everything random comes from it and from the condition's name."""
    profile: str
    n_steps: int
    what: str
    """Which experiment: actions, sensors or n_actions."""
    condition: str
    """Row of the experiment's table."""
    evolved: str
    """Folder name of the evolved run."""
    actions: ActionSettings
    """How actions are clustered where they are extracted; their number in any case."""
    learner: LearnerSettings
    episodes: int
    lanes: int
    """Learners that one program runs side by side. Other widths are rounded differently, in the last bits."""
