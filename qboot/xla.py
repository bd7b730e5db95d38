"""The one place where XLA's flags are set.

XLA's CPU runtime dispatches every operation of a loop body separately. A robot simulation is a long loop over
hundreds of tiny operations, so the dispatch costs more than the arithmetic. The option below compiles small loops
into one kernel each. It has to be in the environment before jax starts its first backend.
"""

import os
import sys

SMALL_LOOP_OPTION = "xla_cpu_small_while_loop_byte_threshold"
SMALL_LOOP_FLAG = f"--xla_backend_extra_options={SMALL_LOOP_OPTION}=1000000000"


def compile_small_loops() -> bool:
    """Ask XLA to compile small CPU loops into one kernel; return whether the option is in force.

    Nothing is changed when jax has computed something already (too late) or when the user has set XLA's extra options.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if not _has_started() and "xla_backend_extra_options" not in flags:
        flags = f"{flags} {SMALL_LOOP_FLAG}".strip()
        os.environ["XLA_FLAGS"] = flags
    return SMALL_LOOP_OPTION in flags


def _has_started() -> bool:
    bridge = sys.modules.get("jax._src.xla_bridge")  # jax has no public way to ask without starting it
    return bridge is not None and bridge.backends_are_initialized()
