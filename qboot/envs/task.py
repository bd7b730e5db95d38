"""What the method needs to know of a robot task.

Everything after the environments (evolution, extraction, Q-learning, the study) talks to a task through this one tuple
of pure functions and numbers; the Brax `Env` classes wrap the same functions. A task of your own is one more `Task`;
what it leaves out, the study does without.

Shape letters used everywhere: B controllers, D domains, T steps, S sensors, E effectors, F frames of a recording.
"""

from __future__ import annotations  # so that what annotations name need not be imported

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    import jax
    from matplotlib.figure import Figure

    from qboot.envs.scene import Scene


class TaskState(Protocol):
    """The fields that every task's state must have; a task adds its own."""

    @property
    def observation(self) -> jax.Array:
        """Sensors (S,) in [0, 1]."""

    @property
    def reward(self) -> jax.Array:
        """Reward () of the last step."""

    @property
    def done(self) -> jax.Array:
        """Whether the rollout is over, () bool; a done state is absorbing: stepping it rewards nothing."""


Domain = Any  # a pytree of arrays: walls, positions, sizes; a set of domains has a leading axis D


class Expert(NamedTuple):
    """What a human would give a Q-learner: the yardstick of the control experiments (section VII)."""

    actions: Callable[[], Any]  # -> qboot.extraction.actions.ActionSet
    sensors: tuple[tuple[str, ...], ...]  # names of the chosen sensors by lag; the first are those of now


class View(NamedTuple):
    """How a task is drawn, on figures and in players."""

    scene: Callable[[Domain, Any], Scene]  # (domain, states (F, ...)) -> scene
    domains: Callable[[], list[tuple[str, Domain]]]  # all domains with their names
    note: str  # what one should know of the domains
    picture: Callable[[Task], tuple[Figure, str]] | None = None  # of the robot, and what it shows


class Task(NamedTuple):
    """A robot task as pure functions on arrays (all of them work under jit, vmap and scan).

    A *timestep* is one primitive step, a *rollout* one run of a controller in one domain. An *episode*, one evaluation
    of a policy, is `rollouts_per_domain` rollouts in each domain of a set; its score is the sum of the rewards earned,
    in units of `reward`.
    """

    name: str
    sensors: tuple[str, ...]
    effectors: tuple[str, ...]
    sources: tuple[str, ...]  # names of the source domain sets
    max_steps: int  # timesteps of one rollout at most
    rollouts_per_domain: int
    max_score_per_domain: int  # of one episode; figures end there
    reward: float  # size of one reward (equations 7 and 8); rewards may be fractions of it
    reset: Callable[[jax.Array, Domain], Any]  # (key, domain) -> TaskState
    step: Callable[[Domain, Any, jax.Array], Any]  # (domain, state, (E,) commands in [0, 1]) -> state
    truncated: Callable[[Any], jax.Array]  # state -> () bool: nothing happens any more, a rollout may stop here
    source_domains: Callable[[str], Domain]  # source name -> domains (D, ...)
    target_domains: Callable[[str], Domain]  # source name -> domains (D, ...), none of them in the source
    position: Callable[[Domain, Any], jax.Array]  # -> () int32 >= 0: cell of the discretised trajectory
    outcome: Callable[[Domain, Any], jax.Array]  # -> (k,) vector compared by the ad hoc distance
    trajectory_period: int  # steps between two recorded cells
    lanes: int = 8  # rollouts that run best side by side on one core
    dt: float = 1.0  # seconds of a timestep; 1 where a task has no clock
    physics: tuple[str, ...] = ("own",)  # names of what it can run on, the one of record first
    on_physics: Callable[[str], Task] | None = None  # the task on another one of them
    expert: Expert | None = None
    view: View | None = None
    # What later rooms ask a task for. Their types live there, since no room knows those after it.
    defaults: Callable[[], Any] | None = None  # -> qboot.study.pipeline.profiles.Defaults; generic ones without
    paper: Callable[[], Any] | None = None  # -> qboot.study.analysis.printed.Paper; None: no paper tells of it
