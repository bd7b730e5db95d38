"""Box pushing (paper, section VI): a robotic arm pushes a block to the left."""

import functools

from qboot.envs.box_pushing import (
    arm,
    defaults,
    dynamics,
    expert,
    paper,
    physics_kinematic,
    physics_mjx,
    view,
)
from qboot.envs.box_pushing import domains as blocks
from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Domain, Expert, Task, View

# What a step can be computed by, the physics of record first.
PHYSICS = {"mjx": physics_mjx.move, "kinematic": physics_kinematic.move}
# Rollouts side by side: a step of MJX costs little more for hundreds than for a few.
LANES = {"mjx": 240, "kinematic": 16}


@functools.cache
def on_physics(physics: str) -> Task:
    """Box pushing on MuJoCo ("mjx", the physics of record) or its closed-form twin ("kinematic").

    Raises:
        ValueError: for another physics.
    """
    if physics not in PHYSICS:
        raise ValueError(f"unknown physics {physics!r}: choose one of {', '.join(PHYSICS)}")
    return Task(
        name="box_pushing",
        sensors=dynamics.SENSORS,
        effectors=dynamics.EFFECTORS,
        sources=("A",),
        max_steps=300,
        rollouts_per_domain=5,
        max_score_per_domain=5,
        reward=dynamics.REWARD,
        reset=dynamics.reset,
        step=functools.partial(dynamics.step, PHYSICS[physics]),
        truncated=dynamics.truncated,
        source_domains=blocks.source_domains,
        target_domains=blocks.target_domains,
        position=dynamics.position,
        outcome=dynamics.outcome,
        trajectory_period=10,
        lanes=LANES[physics],
        dt=arm.TIME_STEP,
        physics=tuple(PHYSICS),
        on_physics=on_physics,
        expert=Expert(expert.actions, expert.CHOSEN_SENSORS),
        view=View(view.scene, view.all_domains, view.NOTE, view.picture),
        defaults=defaults.defaults,
        paper=paper.paper,
    )


TASK = on_physics("mjx")


class BoxPushing(TaskEnv):
    """Box pushing as a Brax environment, also `brax.envs.get_environment("qboot_box_pushing")`.

    Example:
        >>> import jax
        >>> from qboot.envs import BoxPushing
        >>> env = BoxPushing(size=4, physics="kinematic")
        >>> env.reset(jax.random.key(0)).obs.shape
        (13,)
    """

    def __init__(
        self,
        size: int = 0,
        physics: str = "mjx",
        *,
        domains: Domain | str | None = None,
        action_range: tuple[float, float] = (0.0, 1.0),
    ):
        """Choose the block, or the set that one is drawn from at each reset, and the physics.

        Args:
            size: 0, 1 or 2, one of the source blocks, or 3, 4 or 5, one of the target blocks.
            physics: "mjx" or "kinematic".
            domains: "source" or "target" set; then the size plays no part.
            action_range: what actions lie in; scaled to commands in [0, 1], clipped outside, NaN is the middle.

        Raises:
            ValueError: for an unknown size, physics or set, or what is no range.
        """
        widths = (*blocks.SOURCE_WIDTHS, *blocks.TARGET_WIDTHS)
        if size not in range(len(widths)):
            raise ValueError(f"unknown block size {size!r}: choose 0 to {len(widths) - 1}")
        domain = blocks.block(widths[size]) if domains is None else None
        super().__init__(on_physics(physics), domain, domains=domains, action_range=action_range)
        self.physics = physics

    @property
    def backend(self) -> str:
        """The physics, "mjx" or "kinematic"."""
        return self.physics


__all__ = ["PHYSICS", "TASK", "BoxPushing", "on_physics"]
