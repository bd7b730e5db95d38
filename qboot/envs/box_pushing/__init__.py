"""Box pushing (paper, section VI): a robotic arm pushes a block to the left."""

import functools

from qboot.envs.box_pushing import (
    defaults,
    domains,
    dynamics,
    expert,
    paper,
    physics_kinematic,
    physics_mjx,
    view,
)
from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Expert, Task, View

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
        source_domains=domains.source_domains,
        target_domains=domains.target_domains,
        position=dynamics.position,
        outcome=dynamics.outcome,
        trajectory_period=10,
        lanes=LANES[physics],
        physics=tuple(PHYSICS),
        on_physics=on_physics,
        expert=Expert(expert.actions, expert.CHOSEN_SENSORS),
        view=View(view.scene, view.all_domains, view.NOTE, view.picture),
        defaults=defaults.defaults,
        paper=paper.paper,
    )


TASK = on_physics("mjx")


class BoxPushing(TaskEnv):
    """Box pushing as a Brax environment."""

    def __init__(self, size: int = 0, physics: str = "mjx"):
        """Choose the block and the physics.

        Args:
            size: 0, 1 or 2, one of the source blocks.
            physics: "mjx" or "kinematic".

        Raises:
            ValueError: for an unknown size or physics.
        """
        if size not in range(len(domains.SOURCE_WIDTHS)):
            raise ValueError(f"unknown block size {size!r}: choose 0, 1 or 2")
        super().__init__(on_physics(physics), domains.block(domains.SOURCE_WIDTHS[size]))
        self.physics = physics

    @property
    def backend(self) -> str:
        """The physics, "mjx" or "kinematic"."""
        return self.physics


__all__ = ["PHYSICS", "TASK", "BoxPushing", "on_physics"]
