"""The learner's settings: section IV-E and appendix B of the paper."""

import math
from dataclasses import dataclass
from numbers import Integral

from qboot.qlearning.learners import LEARNERS

HISTORIES = ("steps", "decisions")


@dataclass(frozen=True)
class LearnerSettings:
    """Everything that decides how one learner learns; hashable, so that it can be static under `jax.jit`.

    Raises:
        ValueError: if a value is not finite, or lies outside the range given under it.
    """

    gamma: float
    """Discount per primitive step, in [0, 1] (0.9991 for ball collecting, 0.99 for box pushing)."""

    alpha: float
    """Learning rate of gradient descent, > 0 (0.001 for ball collecting, 0.1 for box pushing)."""

    hidden: int
    """Hidden neurons of each action's network, >= 1 (125 for ball collecting, 35 for box pushing)."""

    epsilon_start: float = 0.15
    """Probability of a random action that the schedule starts from, in [0, 1]."""

    epsilon_end: float = 0.01
    """Probability of a random action that the schedule tends to, in [0, 1]."""

    epsilon_stepness: float = 0.99
    """Factor per episode of the distance between start and end, in [0, 1]."""

    eta: int = 3
    """Trajectories kept for replay in each domain, >= 0."""

    history: str = "steps"
    """What a lag counts: primitive "steps" (the paper's o(t - k)) or "decisions" (one per action)."""

    lags: int = 12
    """Observations remembered, the current one included, >= 1: the largest lag that an input may have."""

    input_range: tuple[float, float] = (0.0, 1.0)
    """What the sensors' range [0, 1] is stretched to before the networks see it, low < high. Sensors that matter in
    steps of a hundredth need a wide one: a network that starts with small weights hardly tells such values apart."""

    algorithm: str = "q_learning"
    """The learner: a name of `qboot.qlearning.LEARNERS`."""

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        for name in ("gamma", "epsilon_start", "epsilon_end", "epsilon_stepness"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie in [0, 1], got {getattr(self, name)}.")
        if not 0 < self.alpha < math.inf:
            raise ValueError(f"alpha must be positive and finite, got {self.alpha}.")
        for name, least in (("hidden", 1), ("lags", 1), ("eta", 0)):
            value = getattr(self, name)
            if not isinstance(value, Integral) or value < least:
                raise ValueError(f"{name} must be a whole number, at least {least}, got {value}.")
        if len(self.input_range) != 2 or not -math.inf < self.input_range[0] < self.input_range[1] < math.inf:
            raise ValueError(f"input_range must be (low, high), finite, with low < high, got {self.input_range}.")
        if self.history not in HISTORIES:
            raise ValueError(f"history must be one of {', '.join(HISTORIES)}, got {self.history!r}.")
        if self.algorithm not in LEARNERS:
            raise ValueError(f"algorithm must be one of {', '.join(LEARNERS)}, got {self.algorithm!r}.")
