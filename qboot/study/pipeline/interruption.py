"""Being interrupted: what is unsaved is saved and what was started is stopped, at once, whatever is being computed.

A compiled program cannot be interrupted, and one call may take hours. So a command works in a thread of its own, while
the main thread waits for signals. On one, it does what the workers asked for with `at_interrupt`, and the process ends.
"""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

# Whoever starts a process names itself in this variable: when it is gone, the process stops too.
PARENT_VARIABLE = "QBOOT_PARENT"
SECONDS_BETWEEN_LOOKS = 0.5
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
is_left = False  # whether work goes on that nobody waits for any more
_actions: dict[object, Callable[[], None]] = {}


class Interrupted(KeyboardInterrupt):
    """A signal to stop: Ctrl-C, a polite kill, a terminal that is closed."""

    def __init__(self, number: int):
        """By the signal of this number."""
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number


@contextlib.contextmanager
def at_interrupt(action: Callable[[], None]) -> Iterator[None]:
    """While in this context, call `action` (from another thread, perhaps) when the command is interrupted."""
    place = object()
    _actions[place] = action
    try:
        yield
    finally:
        _actions.pop(place, None)


def run_interruptible(work: Callable[[], None]) -> None:
    """Do `work` in a thread; raise what it raises, or `Interrupted`, when all asked for with `at_interrupt` is done.

    After `Interrupted`, the work may still go on: the process is to end, by `os._exit`.
    """
    global is_left
    errors: list[BaseException] = []
    done = threading.Event()

    def attempt() -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)
        finally:
            done.set()

    with _signals_raise():
        try:
            threading.Thread(target=attempt, daemon=True).start()
            # An interrupted `join` would take the thread for ended. And a signal that comes just before this thread
            # goes to sleep, or to another thread, does not wake it: so it looks for itself.
            while not done.wait(SECONDS_BETWEEN_LOOKS):
                pass
        except KeyboardInterrupt:
            is_left = not done.is_set()
            for action in list(_actions.values()):
                action()
            raise
    if errors:
        raise errors[0]


def stop_without(parent: int) -> None:
    """Have this process stop, as if interrupted, soon after the process `parent`, which started it, is gone."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(SECONDS_BETWEEN_LOOKS)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def _signals_raise() -> Iterator[None]:
    """Signals to stop raise `Interrupted` in the main thread; those that are ignored (`nohup`) stay so."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise Interrupted(number)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
