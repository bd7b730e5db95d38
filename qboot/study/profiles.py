"""Profiles: how large a study is. They scale sizes alone; every other parameter is the paper's (appendix B)."""

from dataclasses import dataclass

from qboot.envs import PHYSICS, TASKS
from qboot.extraction.actions import ActionSettings
from qboot.extraction.sensors import SensorSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.qlearning.settings import LearnerSettings
from qboot.study.runs import RunSettings


@dataclass(frozen=True)
class Size:
    """Sizes of one task in one profile."""

    runs_per_source: int
    sources: tuple[str, ...]
    population: int
    generations: int
    n_steps: int
    horizon: int
    episodes: int
    target_episodes: int
    target_generations: int


PROFILES = {
    # Every stage, every figure, in minutes: shows that all works, says nothing about the method.
    "smoke": {
        "ball_collecting": Size(1, ("A",), 16, 4, 400, 4, 6, 6, 2),
        "box_pushing": Size(1, ("A",), 16, 4, 100, 4, 6, 6, 2),
    },
    # Curves that rise, on two cores, while one has a coffee.
    "quick": {
        "ball_collecting": Size(1, ("A", "B"), 128, 250, 4_000, 500, 800, 200, 25),
        "box_pushing": Size(2, ("A",), 128, 40, 300, 500, 150, 100, 6),
    },
    # A night on a desktop.
    "standard": {
        "ball_collecting": Size(4, ("A", "B", "C"), 128, 600, 10_000, 500, 2_000, 2_000, 300),
        "box_pushing": Size(10, ("A",), 128, 400, 300, 500, 2_000, 2_000, 300),
    },
    # As printed: 30 runs a task; ER on the target set up to the paper's median.
    "paper": {
        "ball_collecting": Size(10, ("A", "B", "C"), 128, 1_000, 10_000, 500, 5_000, 10_000, 2_500),
        "box_pushing": Size(30, ("A",), 128, 1_000, 300, 500, 5_000, 6_000, 2_000),
    },
}


@dataclass(frozen=True)
class SweepSize:
    """Size of one control experiment (section VII)."""

    runs: int
    """Learners per condition."""
    episodes: int


def _sweeps(runs: int, **episodes: int) -> dict[str, SweepSize]:
    return {what: SweepSize(runs, n) for what, n in episodes.items()}


# The experiments in the order of the paper: sections VII-A, VII-B, VII-C.
SWEEPS = {
    "smoke": {
        "ball_collecting": _sweeps(2, actions=4, sensors=4, n_actions=4),
        "box_pushing": _sweeps(2, actions=4, sensors=4, n_actions=4),
    },
    "quick": {
        "ball_collecting": _sweeps(3, actions=80, sensors=80, n_actions=80),
        "box_pushing": _sweeps(3, actions=100, sensors=100, n_actions=100),
    },
    "standard": {
        "ball_collecting": _sweeps(10, actions=2_000, sensors=2_000, n_actions=2_000),
        "box_pushing": _sweeps(10, actions=2_000, sensors=2_000, n_actions=2_000),
    },
    "paper": {
        "ball_collecting": _sweeps(30, actions=10_000, sensors=10_000, n_actions=5_000),
        "box_pushing": _sweeps(30, actions=5_000, sensors=5_000, n_actions=5_000),
    },
}

# Learners side by side in a program. On a CPU about as fast as one after another, and compiled once for all.
LANES = 5
# Box pushing starts at random, so a score is partly luck.
REEVALUATE = {"ball_collecting": False, "box_pushing": True}
ACTIONS = {
    "ball_collecting": ActionSettings(n_actions=17),
    # The hand crosses its window of success in one or two steps, so the actions that matter are short.
    "box_pushing": ActionSettings(n_actions=7, min_duration=1, max_duration=20, restarts=10),
}
LEARNERS = {
    "ball_collecting": LearnerSettings(gamma=0.9991, alpha=0.001, hidden=125, history="decisions"),
    "box_pushing": LearnerSettings(gamma=0.99, alpha=0.01, hidden=35, input_range=(-3.0, 3.0)),
}


def size_of(task: str, profile: str) -> Size:
    """Sizes of a task in a profile.

    Raises:
        ValueError: for an unknown task or profile.
    """
    if profile not in PROFILES:
        raise ValueError(f"unknown profile {profile!r}: choose one of {', '.join(PROFILES)}")
    if task not in PROFILES[profile]:
        raise ValueError(f"unknown task {task!r}: choose one of {', '.join(PROFILES[profile])}")
    return PROFILES[profile][task]


def sweep_of(task: str, what: str, profile: str) -> SweepSize:
    """Size of a control experiment in a profile.

    Raises:
        ValueError: for an unknown task, experiment or profile.
    """
    size_of(task, profile)
    sweeps = SWEEPS[profile][task]
    if what not in sweeps:
        raise ValueError(f"unknown experiment {what!r}: choose one of {', '.join(sweeps)}")
    return sweeps[what]


def settings_of(task: str, profile: str, source: str, seed: int) -> RunSettings:
    """All settings of one run.

    Raises:
        ValueError: for an unknown task, profile or source, or a negative seed.
    """
    size = size_of(task, profile)
    if source not in TASKS[task].sources:
        raise ValueError(f"unknown source {source!r} of {task}: choose one of {', '.join(TASKS[task].sources)}")
    return RunSettings(
        task=task,
        source=source,
        physics=PHYSICS[task][0],
        seed=seed,
        profile=profile,
        n_steps=size.n_steps,
        dnn=DnnSettings(feed_forward=TASKS[task].feed_forward),
        evolution=EvolutionSettings(
            population=size.population,
            generations=size.generations,
            horizon=size.horizon,
            reevaluate=REEVALUATE[task],
        ),
        actions=ACTIONS[task],
        sensors=SensorSettings(),
        learner=LEARNERS[task],
        episodes=size.episodes,
        target_episodes=size.target_episodes,
        target_generations=size.target_generations,
    )


def runs_of(task: str, profile: str) -> list[RunSettings]:
    """The settings of all runs of a task in a profile."""
    size = size_of(task, profile)
    return [settings_of(task, profile, source, seed) for source in size.sources for seed in range(size.runs_per_source)]
