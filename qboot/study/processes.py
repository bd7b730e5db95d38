"""Processes that this one starts and that never outlive it."""

import os
import signal
import subprocess
import threading
import time

from qboot.study.pipeline.interruption import PARENT_VARIABLE

# To save what they have, before they are killed.
SECONDS_TO_STOP = 4.0
_stopping = threading.Event()
_running: set[subprocess.Popen] = set()


def run(command: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a `qboot` command to its end; its output as text, in UTF-8.

    It is in a group of its own: Ctrl-C reaches it through `stop_all`. When this process is killed, it notices and stops
    by itself.
    """
    if _stopping.is_set():
        return subprocess.CompletedProcess(command, 128 + signal.SIGTERM, "", "stopped")
    process = subprocess.Popen(
        command,
        env=environment | {PARENT_VARIABLE: str(os.getpid()), "PYTHONIOENCODING": "utf-8"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    )
    _running.add(process)
    try:
        output, errors = process.communicate()
    finally:
        _running.discard(process)
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


def stop_all() -> None:
    """Have all that run save and stop, kill those that take too long, and let no other one start."""
    _stopping.set()
    some = list(_running)
    for process in some:
        process.send_signal(signal.SIGTERM)
    until = time.monotonic() + SECONDS_TO_STOP
    for process in some:
        try:
            process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
