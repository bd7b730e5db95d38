"""Where a step of a run puts its files and its checkpoints, each marked with what it was made with."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from qboot.study.store import files, provenance
from qboot.study.store.files import RunError
from qboot.study.store.recipes import Recipe
from qboot.study.store.runs import AnyRun

Value = TypeVar("Value")
# A checkpoint is replaced again and again: it carries its identity itself.
IDENTITY = "identity"


class Output(NamedTuple):
    """Where one step of a run puts what it makes."""

    run: AnyRun
    recipe: Recipe

    def has(self, name: str) -> bool:
        """Whether a file is there already, whole and made as it should be."""
        return provenance.is_whole(self.run, name)

    def write_csv(self, name: str, columns: Mapping[str, Sequence]) -> None:
        """Write named columns of equal length.

        Raises:
            RunError: if a number is none.
        """
        for column, values in columns.items():
            self._check(name, column, np.asarray(values))
        self._write(name, files.csv_bytes(columns))

    def write_npz(self, name: str, arrays: Mapping[str, np.ndarray], may_be_nan: tuple[str, ...] = ()) -> None:
        """Write named arrays, in which some `may_be_nan`.

        Raises:
            RunError: if a number is none where there has to be one.
        """
        for array, values in arrays.items():
            if array not in may_be_nan:
                self._check(name, array, np.asarray(values))
        self._write(name, files.npz_bytes(arrays))

    def save(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Write a checkpoint."""
        files.write_npz(self.run.file(name), {**arrays, IDENTITY: np.array(self._identity(name))})

    def restored(self, name: str, restore: Callable[[dict[str, np.ndarray], Path], Value]) -> Value | None:
        """What `restore` makes of the arrays (and the path) of a checkpoint; None if there is none.

        A checkpoint that is damaged, or was made with other settings or from other files, counts as none and is
        set aside.
        """
        path = self.run.file(name)
        if not path.exists():
            return None
        try:
            arrays = files.read_npz(path)
            if str(files.pick(arrays, IDENTITY, path)) == self._identity(name):
                return restore(arrays, path)
            wrong = "was made with other settings, or from other files than those of now"
        except RunError:
            wrong = "is damaged"
        files.set_aside(path, wrong)
        return None

    def _identity(self, checkpoint: str) -> str:
        return f"{checkpoint} {provenance.identity(self.run, self.recipe)}"

    def _write(self, name: str, content: bytes) -> None:
        files.write(self.run.file(name), content, before=lambda digest: provenance.record(self.run, name, digest))

    def _check(self, name: str, column: str, values: np.ndarray) -> None:
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise RunError(f"{self.run.file(name)} is not written, for {column} is no number (NaN or infinite) in it")
