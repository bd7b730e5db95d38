"""The flags that XLA is given."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from qboot.extraction.traces import traces
from qboot.study.pipeline.evolving import source_problem
from qboot.study.store import runs
from qboot.study.store.artifacts import read_lineage
from qboot.xla import INSTRUCTIONS, SMALL_LOOPS, with_flags

PUBLISHED = Path(__file__).parent.parent / "docs/data/standard"


@pytest.mark.parametrize(
    ("before", "expected"), [("import jax", with_flags("", platform.machine())), ("import jax; jax.devices()", "")]
)
def test_flags_are_set_until_jax_has_started(before, expected):
    code = f"{before}; import qboot.xla; print(qboot.xla.set_flags())"
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == expected


@pytest.mark.parametrize(
    ("flags", "machine", "expected"),
    [
        ("", "arm64", SMALL_LOOPS),
        ("", "AMD64", f"{SMALL_LOOPS} {INSTRUCTIONS}"),
        ("--xla_cpu_max_isa=SSE4_2", "x86_64", f"--xla_cpu_max_isa=SSE4_2 {SMALL_LOOPS}"),
        ("--xla_backend_extra_options=a=1", "x86_64", f"--xla_backend_extra_options=a=1 {INSTRUCTIONS}"),
        (f"{SMALL_LOOPS} {INSTRUCTIONS}", "x86_64", f"{SMALL_LOOPS} {INSTRUCTIONS}"),
    ],
)
def test_what_the_user_has_set_is_kept(flags, machine, expected):
    assert with_flags(flags, machine) == expected


@pytest.mark.skipif(
    os.environ.get("XLA_FLAGS", "") != with_flags("", "x86_64") or jax.default_backend() != "cpu",
    reason="needs the flags as qboot sets them on an x86 processor",
)
def test_networks_score_to_the_ball_what_they_did_on_another_processor():
    """Evolved on an Intel Xeon; an AMD EPYC with bfloat16 instructions, left to use them, plays 25 of 32 otherwise."""
    run = runs.load(PUBLISHED / "ball_collecting" / "B-2")
    ancestors = jax.tree.map(lambda leaf: leaf[-32:], read_lineage(run))
    _, scores = traces(source_problem(run, 1), ancestors, lambda *_, **__: None)
    np.testing.assert_array_equal(scores, ancestors.scores)
