"""Settings of neuro-evolution (paper, appendix B)."""

from dataclasses import dataclass, field

from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.variation import MutationRates


@dataclass(frozen=True)
class EvolutionSettings:
    """Parameters of neuro-evolution. Raises `ValueError` when a value lies outside the range given under it."""

    algorithm: str = "nsga2"
    """Name of the evolutionary algorithm."""
    population: int = 128
    """Individuals that survive a generation, and children born in it, >= 2."""
    generations: int = 1000
    """Generations after the first, >= 0."""
    diversity_period: int = 50
    """Generations after which the behavioural distance in force is drawn anew, >= 1."""
    diversities: tuple[str, ...] = ("adhoc", "hamming", "entropy", "trajectory")
    """Behavioural distances to draw from."""
    horizon: int = 500
    """H: ancestors kept in the lineage of the best-of-run, itself included, >= 1."""
    rates: MutationRates = field(default_factory=MutationRates)
    newborn_first: bool = False
    """Of individuals that the crowded comparison holds for equal, the newborn survive; else the older ones."""
    reevaluate: bool = False
    """Evaluate survivors again in every generation, all on the same starts as the newborn. For tasks that start at
    random: an individual that was lucky once does not stay for its luck. It doubles the episodes."""

    @property
    def keeps_best(self) -> bool:
        """Whether the best score of the population never falls."""
        return ALGORITHMS[self.algorithm].keeps_best and not self.reevaluate

    def __post_init__(self):
        """Refuse values outside their range."""
        if self.algorithm not in ALGORITHMS:
            raise ValueError(f"algorithm is {self.algorithm!r}: it must be one of {', '.join(ALGORITHMS)}")
        for name, least in (("population", 2), ("generations", 0), ("diversity_period", 1), ("horizon", 1)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be at least {least}")
        unknown = set(self.diversities) - set(DISTANCES)
        if unknown or not self.diversities:
            raise ValueError(f"diversities must be among {', '.join(DISTANCES)}, not {sorted(unknown) or 'none'}")
