"""The one loop that steps, reports and saves: evolution, learning and sweeps of learners all run in it."""

import time
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

State = TypeVar("State")
SECONDS_BETWEEN_SAVES = 20.0


class Work(NamedTuple, Generic[State]):
    """Something long that is done step by step."""

    total: int
    done: Callable[[State], int]  # how much of the total is done
    step: Callable[[State], State]
    save: Callable[[State], None]  # so that the work can go on from this state
    report: Callable[[State], None]  # how far it is, to whoever watches


def advance(work: Work[State], state: State) -> State:
    """Step from `state` to the end; save now and then, at the end, and when the user interrupts."""
    saved = time.monotonic()
    unsaved = False
    try:
        while work.done(state) < work.total:
            state = work.step(state)
            unsaved = True
            work.report(state)
            if time.monotonic() > saved + SECONDS_BETWEEN_SAVES or work.done(state) >= work.total:
                work.save(state)
                saved, unsaved = time.monotonic(), False
    except KeyboardInterrupt:
        if unsaved:
            work.save(state)
        raise
    return state
