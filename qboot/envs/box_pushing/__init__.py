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
