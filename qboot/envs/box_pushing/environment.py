"""Box pushing as a Brax environment; apart from the task, which does not need Brax."""

from qboot.envs.box_pushing import domains as blocks
from qboot.envs.box_pushing import on_physics
from qboot.envs.brax_env import TaskEnv
from qboot.envs.task import Domain


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
