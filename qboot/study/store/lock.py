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
    the owner counts, as long as its process is alive on this machine.

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
            if _is_taken(handle, owner):
                raise RunError(
                    f"{path.parent} is in use by {owner or 'another process'}: wait until it is done, or stop it first"
                )
            if _is_at(handle, path):
                os.ftruncate(handle, 0)
                os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # the last owner removed this file in the meantime


def _is_taken(handle: int, owner: str) -> bool:
    """Whether another process has the lock; if not, this one has it now."""
    try:
        if fcntl is None:
            raise OSError("no locks here")
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    except BlockingIOError:
        return True
    except OSError:
        words = owner.split()
        is_name = len(words) == 4 and words[1].isdecimal()
        is_other = is_name and (words[3] != socket.gethostname() or int(words[1]) != os.getpid())
        return is_other and (words[3] != socket.gethostname() or files.is_alive(int(words[1])))


def _is_at(handle: int, path: Path) -> bool:
    """Whether the open file is still the one of that name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
