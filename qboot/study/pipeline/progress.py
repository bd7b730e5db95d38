"""How far a stage is: a bar with time left for people, or a small file for the runner that started the stage."""

import json
import os
import threading
import time
from pathlib import Path
from types import TracebackType

from tqdm import tqdm

# A runner that shows the progress of several stages names the file in this variable.
STATUS_VARIABLE = "QBOOT_STATUS"
SECONDS_BETWEEN_REPORTS = 0.5


class Progress:
    """Progress of one stage, which several threads may report; use it as a context."""

    def __init__(self, label: str, unit: str, total: int, done: int = 0):
        """Progress of `label`, counted in `unit`, of which `done` of `total` are done already."""
        status = os.environ.get(STATUS_VARIABLE)
        self._status = Path(status) if status else None
        self._label, self._total = label, total
        self._reported = 0.0
        self._one_at_a_time = threading.Lock()  # their file is one
        look = {"desc": label, "unit": f" {unit}", "dynamic_ncols": True}
        self._bar = None if status else tqdm(total=total, initial=done, **look)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.close()

    def update(self, done: int, **figures: float | int | str) -> None:
        """Say that `done` of the total are done, with figures worth watching, such as the best score."""
        text = ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in figures.items()
        )
        with self._one_at_a_time:
            self._report(done, text)

    def _report(self, done: int, text: str) -> None:
        if self._bar is not None:
            self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(done - self._bar.n)
        elif self._status is not None and (
            time.monotonic() > self._reported + SECONDS_BETWEEN_REPORTS or done >= self._total
        ):
            self._reported = time.monotonic()
            status = {"label": self._label, "done": done, "total": self._total, "text": text}
            part = self._status.with_suffix(".part")
            part.write_text(json.dumps(status))
            os.replace(part, self._status)
