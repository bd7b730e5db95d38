"""Compiled programs that processes share."""

import subprocess
import sys
import threading
import time
from pathlib import Path

from jax._src import lru_cache

from qboot.study.store import programs

PROGRAM = bytes(30_000_000)


def store_in(folder):
    """JAX's own store of programs, as tests use it: `conftest` has had it write programs whole."""
    return lru_cache.LRUCache(str(folder), max_size=-1)


def test_a_program_is_never_read_half_written(tmp_path):
    store = store_in(tmp_path)
    seen, is_over = set(), threading.Event()

    def read():
        while not is_over.is_set():
            found = store.get("jit_f-0123")
            seen.add(None if found is None else len(found))

    reader = threading.Thread(target=read)
    reader.start()
    for _ in range(10):
        store.put("jit_f-0123", PROGRAM)
    while len(PROGRAM) not in seen:
        time.sleep(0.01)
    is_over.set()
    reader.join()
    assert seen - {None} == {len(PROGRAM)}
    assert [path.name for path in tmp_path.iterdir()] == ["jit_f-0123-cache"]


def test_a_program_that_was_cut_off_is_replaced(tmp_path):
    store = store_in(tmp_path)
    (tmp_path / "jit_f-0123-cache").write_bytes(b"ha")
    store.put("jit_f-0123", b"whole")
    assert store.get("jit_f-0123") == b"whole"


def test_a_kill_while_a_program_is_written_leaves_none_and_its_part_is_removed(tmp_path, monkeypatch):
    code = f"""
import os, signal
from jax._src import lru_cache
from qboot.study.store import programs

programs.write_whole()

def cut_off(handle):
    os.ftruncate(handle, 500)
    os.kill(os.getpid(), signal.SIGKILL)

os.fsync = cut_off
lru_cache.LRUCache({str(tmp_path)!r}, max_size=-1).put("jit_f-0123", bytes(1000))
"""
    assert subprocess.run([sys.executable, "-c", code]).returncode == -9
    [part] = tmp_path.iterdir()
    assert part.name.endswith(".part") and part.stat().st_size == 500
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(programs.jax.config, "update", lambda name, value: None)
    programs.share(Path("unused"))
    assert not list(tmp_path.iterdir())


def test_programs_can_be_written_by_the_installed_jax():
    """What is exchanged is what JAX calls: if this fails, JAX has changed, see `programs.write_whole`."""
    programs.write_whole()
    assert lru_cache.LRUCache.put.__module__ == programs.__name__
