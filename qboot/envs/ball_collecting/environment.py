"""Ball collecting as a Brax environment; apart from the task, which does not need Brax."""

from qboot.envs.ball_collecting import TASK
from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Domain


class BallCollecting(TaskEnv):
    """Ball collecting as a Brax environment, also `brax.envs.get_environment("qboot_ball_collecting")`.

    Example:
        >>> import jax
        >>> from qboot.envs import BallCollecting
        >>> env = BallCollecting(domains="target", source="A")
        >>> int(env.reset(jax.random.key(0)).info["domain"]) in range(6)
        True
    """

    def __init__(
        self,
        arena: str = "A",
        placement: int = 0,
        *,
        domains: Domain | str | None = None,
        source: str | None = None,
        action_range: tuple[float, float] = (0.0, 1.0),
    ):
        """Choose the domain, or the set that one is drawn from at each reset.

        Args:
            arena: "A", "B" or "C".
            placement: 0, 1 or 2, where robot, balls, switch and basket are.
            domains: "source" or "target" set of a `source`; then arena and placement play no part.
            source: "A", "B" or "C", the arena of the source set.
            action_range: what actions lie in; scaled to commands in [0, 1], clipped outside, NaN is the middle.

        Raises:
            ValueError: for an unknown arena, placement, set or source, or what is no range.
        """
        domain = arenas.arena(arena, placement) if domains is None else None
        super().__init__(TASK, domain, domains=domains, source=source, action_range=action_range)
