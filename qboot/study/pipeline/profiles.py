"""Profiles: how large a study is. They scale sizes alone; every other parameter is the task's default."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from qboot.envs.registry import canonical, get_task
from qboot.envs.task import Task
from qboot.extraction.actions import ActionSettings
from qboot.extraction.sensors import SensorSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.qlearning.settings import LearnerSettings
from qboot.study.store.settings import RunSettings


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


@dataclass(frozen=True)
class ControlSize:
    """Size of one control experiment (section VII)."""

    runs: int
    """Learners per condition."""
    episodes: int


class Costs(NamedTuple):
    """Rates of one task on one machine, in core-seconds where nothing else is said."""

    start: float  # a process and its libraries
    compile_evolution: float  # the program that evaluates a block of controllers
    compile_learning: float  # the program of an episode of Q-learning
    rollout_step: float  # evolution: a step that a robot lives, with network and recorder
    acting_step: float  # Q-learning: a step of the robot
    update: float  # Q-learning: an update, were the networks without weights
    weight: float  # Q-learning: what each input weight of all networks adds to an update
    lived: float  # share of the longest rollout that a Q-learner lives
    lived_evolving: float  # the same of evolving robots, from runs of full size: early ones live shorter or longer


# On a core of an Intel Xeon (AVX-512), jax 0.10: for the weights of the progress bar, whose proportions alone count.
START = 4.0
USUAL = Costs(START, 9.0, 4.5, 4.4e-7, 1.3e-6, 5e-6, 8e-11, 1.0, 1.0)


class Defaults(NamedTuple):
    """What a task's runs are made with, unless told otherwise."""

    # By profile. Smoke: does it all work? Quick: curves that rise. Standard: nights on a desktop. Paper: its sizes.
    sizes: Mapping[str, Size]
    controls: Mapping[str, Mapping[str, ControlSize]]  # by profile, then by control experiment
    learner: LearnerSettings
    evolution: EvolutionSettings = EvolutionSettings()
    dnn: DnnSettings = DnnSettings()
    actions: ActionSettings = ActionSettings()
    sensors: SensorSettings = SensorSettings()
    n_actions: tuple[int, ...] = (4, 8, 17, 30, 50)  # compared by the control experiment on their number
    random_durations: tuple[int, int] = (5, 25)  # of random actions: shortest and longest, in steps
    usual_costs: Costs = USUAL  # unmeasured


def controls(runs: int, **episodes: int) -> dict[str, ControlSize]:
    """The control experiments of a profile with their episodes, in the order of the paper (sections VII-A, -B, -C)."""
    return {what: ControlSize(runs, n) for what, n in episodes.items()}


def defaults_of(task: Task) -> Defaults:
    """A task's own defaults, or, if it brings none, general ones scaled to its rollouts."""
    return task.defaults() if task.defaults else _general(task)


def size_of(task: Task, profile: str) -> Size:
    """Sizes of a task in a profile.

    Raises:
        ValueError: for an unknown profile.
    """
    sizes = defaults_of(task).sizes
    if profile not in sizes:
        raise ValueError(f"unknown profile {profile!r}: choose one of {', '.join(sizes)}")
    return sizes[profile]


def control_size_of(task: Task, what: str, profile: str) -> ControlSize:
    """Size of a control experiment in a profile.

    Raises:
        ValueError: for an unknown profile or experiment.
    """
    size_of(task, profile)
    sizes = defaults_of(task).controls[profile]
    if what not in sizes:
        raise ValueError(f"unknown experiment {what!r}: choose one of {', '.join(sizes)}")
    return sizes[what]


def settings_of(name: str, profile: str, source: str, seed: int, physics: str | None = None) -> RunSettings:
    """All settings of one run of the task `name` (as `qboot.envs.get_task` finds it); None is the physics of record.

    Raises:
        ValueError: for an unknown task, profile, source or physics, or a negative seed.
    """
    task = get_task(name, physics)
    size, defaults = size_of(task, profile), defaults_of(task)
    if source not in task.sources:
        raise ValueError(f"unknown source {source!r} of {task.name}: choose one of {', '.join(task.sources)}")
    return RunSettings(
        task=canonical(name),
        source=source,
        physics=physics or task.physics[0],
        seed=seed,
        profile=profile,
        n_steps=size.n_steps,
        dnn=replace(defaults.dnn, n_inputs=len(task.sensors), n_outputs=len(task.effectors)),
        evolution=replace(
            defaults.evolution, population=size.population, generations=size.generations, horizon=size.horizon
        ),
        actions=defaults.actions,
        sensors=defaults.sensors,
        learner=defaults.learner,
        episodes=size.episodes,
        target_episodes=size.target_episodes,
        target_generations=size.target_generations,
    )


def runs_of(name: str, profile: str, physics: str | None = None) -> list[RunSettings]:
    """The settings of all runs of a task in a profile, on the physics of record by default."""
    size = size_of(get_task(name), profile)
    return [
        settings_of(name, profile, source, seed, physics)
        for source in size.sources
        for seed in range(size.runs_per_source)
    ]


def _general(task: Task) -> Defaults:
    """Defaults for a task that brings none: the method's own, with sizes that fit a robot on two cores."""
    sources, steps = task.sources, task.max_steps
    n_first = len(task.sensors) * len(task.effectors)
    return Defaults(
        sizes={
            "smoke": Size(1, sources[:1], 16, 4, min(steps, 100), 4, 6, 6, 2),
            "quick": Size(1, sources, 64, 60, steps, 500, 200, 100, 10),
            "standard": Size(5, sources, 128, 400, steps, 500, 2_000, 2_000, 300),
            "paper": Size(10, sources, 128, 1_000, steps, 500, 5_000, 6_000, 2_000),
        },
        controls={
            "smoke": controls(2, actions=4, sensors=4, n_actions=4),
            "quick": controls(3, actions=100, sensors=100, n_actions=100),
            "standard": controls(10, actions=2_000, sensors=2_000, n_actions=2_000),
            "paper": controls(30, actions=5_000, sensors=5_000, n_actions=5_000),
        },
        # A reward halfway through a rollout is still worth a third of one now.
        learner=LearnerSettings(gamma=1.0 - 2.0 / max(steps, 3), alpha=0.01, hidden=50),
        # Room for as many connections again as the first generation has.
        dnn=DnnSettings(
            n_inputs=len(task.sensors), n_outputs=len(task.effectors), max_connections=max(75, 2 * n_first)
        ),
        actions=ActionSettings(n_actions=8, min_duration=1, max_duration=max(1, steps // 10)),
        n_actions=(4, 8, 16),
        random_durations=(1, max(2, steps // 20)),
    )
