"""The tasks of the paper in Brax's registry of environments, without loading Brax before somebody does, and quietly.

Brax loads MJX, and so does the arm: either tells on stdout what optional packages it lacks, and stdout belongs to the
programs.
"""

import contextlib
import importlib.abc
import importlib.util
import io
import sys
from types import ModuleType
from typing import Any

ENVIRONMENTS = "brax.envs"
TALKATIVE = ("brax", ENVIRONMENTS, "mujoco.mjx")


def register_when_imported() -> None:
    """Make `brax.envs.get_environment` know our environments: now if Brax is loaded, or else when it will be."""
    loaded = sys.modules.get(ENVIRONMENTS)
    if loaded is not None and hasattr(loaded, "register_environment"):
        _register(loaded)
    elif not any(isinstance(finder, _AfterImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterImport())


def ball_collecting(**settings: Any) -> Any:
    """`qboot.envs.BallCollecting` with its arguments."""
    from qboot.envs.ball_collecting.environment import BallCollecting

    return BallCollecting(**settings)


def box_pushing(**settings: Any) -> Any:
    """`qboot.envs.BoxPushing` with its arguments."""
    from qboot.envs.box_pushing.environment import BoxPushing

    return BoxPushing(**settings)


def _register(brax_envs: ModuleType) -> None:
    brax_envs.register_environment("qboot_ball_collecting", ball_collecting)
    brax_envs.register_environment("qboot_box_pushing", box_pushing)


class _AfterImport(importlib.abc.MetaPathFinder):
    """Waits for the imports of Brax and MJX, lets the usual finders do them, quietly, and registers afterwards."""

    def __init__(self):
        self.is_busy = False

    def find_spec(self, fullname, path, target=None):
        if self.is_busy or fullname not in TALKATIVE:
            return None
        self.is_busy = True  # the search below comes by here again
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            self.is_busy = False
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            with contextlib.redirect_stdout(io.StringIO()):
                execute(module)
            if fullname == ENVIRONMENTS:
                _register(module)

        spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
