"""Something read from several runs: the values, why some have none, and which run is the best."""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from qboot.study.analysis.curves import source_curve
from qboot.study.store import provenance
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

Value = TypeVar("Value")


class Gathered(NamedTuple, Generic[Value]):
    """Something read from several runs."""

    found: dict[Run[RunSettings], Value]
    missing: dict[Run[RunSettings], str]  # why there is none


def gather(some: list[Run[RunSettings]], read: Callable[[Run[RunSettings]], Value]) -> Gathered[Value]:
    """Call `read` on each run; runs that lack what it needs are told apart."""
    found, missing = {}, {}
    for run in some:
        try:
            found[run] = read(run)
        except RunError as error:
            missing[run] = str(error)
    return Gathered(found, missing)


def best_run(some: list[Run[RunSettings]], *needed: str) -> Run[RunSettings]:
    """The run whose evolution scored highest, the first of equals, among those that have the files `needed`.

    Raises:
        RunError: if none has them.
    """
    ready = [run for run in some if all(provenance.is_whole(run, name) for name in needed)]
    scores = gather(ready, best_score).found
    if not scores:
        raise RunError(f"no run has {' and '.join(('history.csv', *needed))}: run the stages")
    return max(scores, key=lambda run: scores[run])


def best_score(run: Run[RunSettings]) -> float:
    """The best score of evolution on the source set."""
    return float(source_curve(run, "ER").scores.max())
