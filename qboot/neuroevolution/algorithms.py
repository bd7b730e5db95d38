"""The evolutionary algorithms by name. Another one is a file with the functions of `Algorithm`, and a row here."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from qboot.neuroevolution import evolve, strategies
from qboot.neuroevolution.dnn import Genome
from qboot.neuroevolution.lineage import Individuals
from qboot.neuroevolution.problem import EvolveInfo, Problem

State = Any  # an algorithm's own tuple of arrays; it has the field `generation`, an int


class Algorithm(NamedTuple):
    """A search for policies, as pure functions of a problem and a state.

    Everything random comes from the problem's key, by names and by numbers that the state holds, so that a run resumed
    from a saved state goes on as if it had never stopped. Individuals are evaluated by `evaluate_individuals`, so that
    those of the lineage can be replayed from the starts of their birth.
    """

    init: Callable[[Problem, Genome | None], tuple[State, EvolveInfo]]
    """(problem, front) -> state of generation 0. `front` (F, ...) holds the networks to start from, None for none."""

    step: Callable[[Problem, State], tuple[State, EvolveInfo]]
    """(problem, state) -> state of the next generation."""

    best_lineage: Callable[[Problem, State], Individuals]
    """(problem, state) -> the best individual so far, last, and what it came from, oldest first: the policies whose
    traces are learned from, `settings.horizon` at most (section IV-A)."""

    pareto_front: Callable[[State], Individuals]
    """(state) -> the individuals that ER + transfer starts from (section IV-F)."""

    saved: type
    """What is saved of a state: a named tuple of arrays, numbers and such tuples, by its annotations."""

    condensed: Callable[[State], Any]
    """(state) -> `saved`, without large parts that can be computed again."""

    restored: Callable[[Problem, Any], State]
    """(problem, saved) -> the state, to the bit."""

    keeps_best: bool
    """Whether the best score in the population never falls, where nobody is evaluated again."""


def _strategy(name: str) -> Algorithm:
    return Algorithm(
        init=partial(strategies.init, name),
        step=partial(strategies.step, name),
        best_lineage=strategies.best_lineage,
        pareto_front=strategies.pareto_front,
        saved=strategies.SearchState,
        condensed=strategies.condensed,
        restored=strategies.restored,
        keeps_best=False,
    )


ALGORITHMS = {
    "nsga2": Algorithm(
        init=evolve.init,
        step=evolve.step,
        best_lineage=evolve.best_lineage,
        pareto_front=evolve.pareto_front,
        saved=evolve.SavedState,
        condensed=evolve.condensed,
        restored=evolve.restored,
        keeps_best=True,  # no one dominates the best, and crowding spares the ends of a front
    ),
    "cma_es": _strategy("cma_es"),
    "open_es": _strategy("open_es"),
    "snes": _strategy("snes"),
}
