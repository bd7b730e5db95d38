"""Ball collecting (paper, section V): a mobile robot brings balls to a basket."""

from qboot.envs.ball_collecting import defaults, domains, dynamics, expert, paper, view
from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Expert, Task, View

TASK = Task(
    name="ball_collecting",
    sensors=dynamics.SENSORS,
    effectors=dynamics.EFFECTORS,
    sources=tuple(domains.ARENAS),
    max_steps=10_000,
    rollouts_per_domain=1,
    max_score_per_domain=4,
    reward=dynamics.REWARD,
    reset=dynamics.reset,
    step=dynamics.step,
    truncated=dynamics.truncated,
    source_domains=domains.source_domains,
    target_domains=domains.target_domains,
    position=dynamics.position,
    outcome=dynamics.outcome,
    trajectory_period=50,
    physics=("fastsim",),
    expert=Expert(expert.actions, expert.CHOSEN_SENSORS),
    view=View(view.scene, view.all_domains, view.NOTE),
    defaults=defaults.defaults,
    paper=paper.paper,
)


class BallCollecting(TaskEnv):
    """Ball collecting as a Brax environment."""

    def __init__(self, arena: str = "A", placement: int = 0):
        """Choose the domain.

        Args:
            arena: "A", "B" or "C".
            placement: 0, 1 or 2, where robot, balls, switch and basket are.

        Raises:
            ValueError: for an unknown arena or placement.
        """
        super().__init__(TASK, domains.arena(arena, placement))


__all__ = ["TASK", "BallCollecting"]
