"""The one place where XLA's flags are set: `XLA_FLAGS` is in the environment before jax starts its first backend.

**Small loops in one kernel.** XLA's CPU runtime dispatches every operation of a loop body separately. A robot
simulation is a long loop over hundreds of tiny operations, so the dispatch costs more than the arithmetic.

**AVX2 at most, which nearly every x86 processor of the last ten years has.** With newer instructions XLA arranges sums
otherwise, on those processors alone: last bits, and after a long computation scores, would depend on where a seed is
run. They also made Q-learning slower (docs/performance.md).
"""

import os
import platform
import sys

SMALL_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
INSTRUCTIONS = "--xla_cpu_max_isa=AVX2"


def set_flags() -> str:
    """Set both flags, but none that the user has set; the flags in force.

    Nothing is changed when jax has computed something already: it is too late.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if not _has_started():
        flags = with_flags(flags, platform.machine())
        os.environ["XLA_FLAGS"] = flags
    return flags


def with_flags(flags: str, machine: str) -> str:
    """The user's flags and, for such a machine, those of ours that they do not set."""
    ours = [SMALL_LOOPS, INSTRUCTIONS] if machine.lower() in ("x86_64", "amd64") else [SMALL_LOOPS]
    return " ".join([*flags.split(), *(flag for flag in ours if flag.split("=")[0] not in flags)])


def _has_started() -> bool:
    bridge = sys.modules.get("jax._src.xla_bridge")  # jax has no public way to ask without starting it
    return bridge is not None and bridge.backends_are_initialized()
