"""Files that appear whole or not at all, and clear words about those that cannot be read."""

import csv
import json
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np

Tree = TypeVar("Tree")


class RunError(Exception):
    """Something about a run that its user can put right; the message is one line that says how."""


def write(path: Path, save: Callable[[Any], None]) -> None:
    """Write a file by `save(binary_stream)`; a kill at any moment leaves the old file or the new one."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}; choose a folder that you may write to") from None
    try:
        with os.fdopen(handle, "wb") as stream:
            save(stream)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)  # mkstemp's files are private
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    write(path, lambda stream: stream.write(text.encode()))


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file."""
    write_text(path, json.dumps(value, indent=1) + "\n")


def write_csv(path: Path, columns: Mapping[str, Sequence]) -> None:
    """Write named columns of equal length."""
    rows = zip(*columns.values(), strict=True)
    text = "\n".join(",".join(_cell(value) for value in row) for row in rows)
    write_text(path, ",".join(columns) + "\n" + text + ("\n" if text else ""))


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays."""
    named: Any = dict(arrays)  # NumPy's own annotation takes every name for a flag
    write(path, lambda stream: np.savez_compressed(stream, **named))


def read_json(path: Path) -> Any:
    """Read a JSON file; raises RunError if there is none or it is damaged."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


def read_csv(path: Path) -> dict[str, list[str]]:
    """Read named columns, as text; raises RunError if there are none or the file is damaged."""
    try:
        with path.open(newline="") as stream:
            rows = list(csv.DictReader(stream, strict=True))
            names = rows[0].keys() if rows else ()
            columns = {name: [row[name] for row in rows] for name in names}
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from None
    if any(value is None for column in columns.values() for value in column):
        raise _unreadable(path, ValueError("a row is cut off"))
    return columns


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Read named arrays; raises RunError if there are none or the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise _unreadable(path, error) from None


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
                f"{expected.dtype}{list(expected.shape)}): delete it and run again"
            )
        found.append(jax.random.wrap_key_data(jnp.asarray(array)) if _is_key(leaf) else array)
    return jax.tree_util.tree_unflatten(structure, found)


def pick(arrays: Mapping[str, np.ndarray], name: str, origin: Path) -> np.ndarray:
    """One of the named arrays read from `origin`; raises RunError if there is none of this name."""
    if name not in arrays:
        raise RunError(f"{origin} lacks {name}: it is not of this version; delete it and run again")
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


def _unreadable(path: Path, error: Exception) -> RunError:
    if isinstance(error, FileNotFoundError):
        return RunError(f"{path} does not exist: run the stage that makes it first")
    if isinstance(error, PermissionError):
        return RunError(f"{path} may not be read: {error.strerror}")
    return RunError(f"{path} is damaged ({error}): delete it and run again, only this file is made anew")
