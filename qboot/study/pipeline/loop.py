"""The one loop that steps, reports and saves: evolution, learning and sweeps of learners all run in it."""

import threading
import time
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from qboot.study.pipeline.interruption import at_interrupt
from qboot.study.store.files import RunError

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
    saved, lock, time_of_save = state, threading.Lock(), time.monotonic()

    def save() -> None:
        nonlocal saved, time_of_save
        with lock:  # an interrupt saves from another thread
            if saved is not state:
                now = state
                work.save(now)
                saved, time_of_save = now, time.monotonic()

    with at_interrupt(save):
        try:
            while work.done(state) < work.total:
                state = work.step(state)
                work.report(state)
                if time.monotonic() > time_of_save + SECONDS_BETWEEN_SAVES or work.done(state) >= work.total:
                    save()
        except (KeyboardInterrupt, RunError):
            save()
            raise
    return state
