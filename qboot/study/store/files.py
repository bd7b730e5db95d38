"""Files that appear whole or not at all, and clear words about those that cannot be read."""

import contextlib
import csv
import errno
import hashlib
import io
import json
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np

Tree = TypeVar("Tree")


class RunError(Exception):
    """Something about a run that its user can put right; the message is one line that says how."""


def write(path: Path, content: bytes, before: Callable[[str], None] = lambda digest: None) -> None:
    """Write a file; a kill at any moment leaves the old file or the new one.

    Args:
        path: where; folders that are missing are made.
        content: all of it.
        before: called with the SHA-256 of the content, in hexadecimal, when it lies on the disk and before it
            appears under its name.

    Raises:
        RunError: if it cannot be written.
    """
    part = _part(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            before(hashlib.sha256(content).hexdigest())
            os.replace(part, path)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise unusable("written", path, error) from None


def write_text(path: Path, text: str) -> None:
    """Write a text file; what is no Unicode (parts of odd paths) is written with backslashes."""
    write(path, text.encode(errors="backslashreplace"))


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file."""
    write_text(path, json.dumps(value, indent=1) + "\n")


def csv_bytes(columns: Mapping[str, Sequence]) -> bytes:
    """Named columns of equal length as the content of a CSV file."""
    rows = zip(*columns.values(), strict=True)
    text = "\n".join(",".join(_cell(value) for value in row) for row in rows)
    return (",".join(columns) + "\n" + text + ("\n" if text else "")).encode()


def npz_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Named arrays as the content of a compressed archive of NumPy's."""
    named: Any = dict(arrays)  # NumPy's own annotation takes every name for a flag
    stream = io.BytesIO()
    np.savez_compressed(stream, **named)
    return stream.getvalue()


def write_csv(path: Path, columns: Mapping[str, Sequence]) -> None:
    """Write named columns of equal length."""
    write(path, csv_bytes(columns))


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays."""
    write(path, npz_bytes(arrays))


def read_json(path: Path) -> Any:
    """Read a JSON file; raises RunError if there is none or it is damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise _unreadable(path, error) from None


def read_csv(path: Path) -> dict[str, list[str]]:
    """Read named columns, as text; raises RunError if there are none or the file is damaged."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream, strict=True))
            names = rows[0].keys() if rows else ()
            columns = {name: [row[name] for row in rows] for name in names}
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from None
    if None in columns or any(value is None for column in columns.values() for value in column):
        raise _unreadable(path, ValueError("a row is cut off, or too long"))
    return columns


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Read named arrays; raises RunError if there are none or the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # a damaged archive may raise whatever its parsers do not expect
        raise _unreadable(path, error) from None


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal; empty if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def set_aside(path: Path, reason: str) -> None:
    """Rename a file that is not to be believed, and say so: nothing that somebody may need is deleted."""
    kept = path.with_name(f"{path.name}.set-aside")
    number = 2
    while kept.exists():
        kept = path.with_name(f"{path.name}.set-aside-{number}")
        number += 1
    try:
        path.rename(kept)
    except OSError as error:
        raise unusable("set aside", path, error) from None
    print(f"qboot: {path} {reason}: set aside as {kept.name}", file=sys.stderr)


def remove(path: Path) -> None:
    """Remove a file, if it is there."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise unusable("removed", path, error) from None


def remove_parts(folder: Path) -> None:
    """Remove what killed processes had begun to write in a folder."""
    for part in folder.glob(".*.part"):
        pid = part.name.split(".")[-2]
        if pid.isdecimal() and (int(pid) == os.getpid() or not is_alive(int(pid))):
            remove(part)


def is_alive(pid: int) -> bool:
    """Whether there is a process of this number on this machine."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is somebody else's
        return True
    return True


def unusable(done: str, path: Path, error: OSError) -> RunError:
    """What the user can do about a file that cannot be `done` ("written", "read" ...)."""
    advice = {
        errno.ENOSPC: "make room on the disk and run the same command again, it goes on from the last save",
        errno.EDQUOT: "make room in your quota and run the same command again, it goes on from the last save",
        errno.ENAMETOOLONG: "choose a shorter path",
        errno.EISDIR: "there is a folder of this name: move it away",
        errno.ENOTDIR: "a part of the path is a file: choose another folder",
        errno.EEXIST: "a part of the path is a file: choose another folder",
        errno.ENOENT: "the folder has vanished: bring it back, or begin again in another one",
        errno.EIO: "the disk reports an error: choose another one",
    }.get(error.errno or 0, "choose a folder that you may write to")
    return RunError(f"{path} cannot be {done} ({error.strerror or error}): {advice}")


def to_arrays(tree: Any) -> dict[str, np.ndarray]:
    """The leaves of a tree of named tuples as named arrays, `field.subfield`; random keys as their data."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {_name(keys): np.asarray(_raw(leaf)) for keys, leaf in leaves}


def from_arrays(arrays: Mapping[str, np.ndarray], kind: type[Tree], origin: Path, prefix: str = "") -> Tree:
    """A named tuple of type `kind`, other named tuples within, out of named arrays read from `origin`.

    Raises:
        RunError: if an array is missing, as in a file of another version.
    """

    def value(name: str, hint: Any) -> Any:
        if hasattr(hint, "_fields"):
            return from_arrays(arrays, hint, origin, f"{prefix}{name}.")
        array = pick(arrays, prefix + name, origin)
        return hint(array) if hint in (int, float) else array

    hints = get_type_hints(kind)
    return kind(**{name: value(name, hints[name]) for name in kind._fields})  # type: ignore[attr-defined]


def like(arrays: Mapping[str, np.ndarray], template: Tree, origin: Path) -> Tree:
    """The tree of the structure, shapes and kinds of `template` out of named arrays read from `origin`.

    The leaves of the template are arrays, or `jax.ShapeDtypeStruct`.

    Raises:
        RunError: if an array is missing or of another shape, as in a file made with other settings.
    """
    leaves, structure = jax.tree_util.tree_flatten_with_path(template)
    found = []
    for keys, leaf in leaves:
        name, expected = _name(keys), _raw(leaf)
        array = pick(arrays, name, origin)
        if array.shape != expected.shape or array.dtype != expected.dtype:
            raise RunError(
                f"{origin} was made with other settings ({name} is {array.dtype}{list(array.shape)}, not "
                f"{expected.dtype}{list(expected.shape)}): delete it and run the stage that makes it again"
            )
        found.append(jax.random.wrap_key_data(jnp.asarray(array)) if _is_key(leaf) else array)
    return jax.tree_util.tree_unflatten(structure, found)


def pick(arrays: Mapping[str, np.ndarray], name: str, origin: Path) -> np.ndarray:
    """One of the named arrays read from `origin`; raises RunError if there is none of this name."""
    if name not in arrays:
        raise RunError(f"{origin} lacks {name}: it is not of this version: delete it and run the stage that makes it")
    return arrays[name]


def _name(keys: tuple) -> str:
    return jax.tree_util.keystr(keys, simple=True, separator=".")


def _is_key(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array) and jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _raw(leaf: Any) -> Any:
    return jax.random.key_data(leaf) if _is_key(leaf) else leaf


def _cell(value: Any) -> str:
    """Numbers so that they can be read back exactly."""
    return repr(value.item()) if isinstance(value, np.generic) else str(value)


def _part(path: Path) -> Path:
    """Where this thread writes a file before it appears whole; short, for the name itself may be as long as can be."""
    return path.with_name(f".{path.name[:40]}.{threading.get_ident()}.{os.getpid()}.part")


def _unreadable(path: Path, error: Exception) -> RunError:
    if isinstance(error, FileNotFoundError):
        return RunError(f"{path} does not exist: run the stage that makes it first")
    if isinstance(error, IsADirectoryError):
        return RunError(f"{path} is a folder: move it away")
    if isinstance(error, OSError) and error.strerror:
        return RunError(f"{path} cannot be read: {error.strerror}")
    words = " ".join(str(error).split()) or type(error).__name__
    return RunError(f"{path} is damaged ({words}): delete it and run the stage that makes it again")
