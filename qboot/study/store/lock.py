"""One owner: while a process works in a folder, no other one does."""

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from qboot.study.store import files
from qboot.study.store.files import RunError

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"


@contextlib.contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Own a folder, which is made if need be, and tidy up what killed owners left of unfinished files.

    The system frees the lock of a process that ends in whatever way. Where the file system has no locks, the name of
    the owner counts: on this machine as long as its process is alive, on another one until somebody deletes the file,
    for nobody can see from here whether it has ended.

    Raises:
        RunError: if another process owns the folder, or it cannot be written.
    """
    path = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = _locked(path)
    except OSError as error:
        raise files.unusable("written", folder, error) from None
    try:
        files.remove_parts(folder)
        yield
    finally:
        with contextlib.suppress(OSError):  # whoever waits for the file that is gone looks again
            path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path) -> int:
    """An open and locked file at `path` with the owner's name in it."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            owner = os.pread(handle, 1000, 0).decode(errors="replace").strip()
            if advice := _advice(handle, path, owner):
                raise RunError(f"{path.parent} is in use by {owner or 'another process'}: {advice}")
            if _is_at(handle, path):
                os.ftruncate(handle, 0)
                os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # the last owner removed this file in the meantime


def _advice(handle: int, path: Path, owner: str) -> str:
    """What to do about another process that has the lock; empty if none has: this one has it now."""
    wait = "wait until it is done, or stop it first"
    try:
        if fcntl is None:
            raise OSError("no locks here")
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return ""
    except BlockingIOError:
        return wait
    except OSError:  # the file system has none
        words = owner.split()
        is_name = len(words) == 4 and words[1].isdecimal()
        is_other = is_name and (words[3] != socket.gethostname() or int(words[1]) != os.getpid())
        is_taken = is_other and (words[3] != socket.gethostname() or files.is_alive(int(words[1])))
        return f"{wait}; if it has ended already, delete {path}" if is_taken else ""


def _is_at(handle: int, path: Path) -> bool:
    """Whether the open file is still the one of that name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
