"""Compiled programs that processes share: in the folder of a study, each whole or not there."""

import os
from pathlib import Path
from typing import Any

import jax

from qboot.study.store import files


def share(out: Path) -> None:
    """Keep what this process and those that it starts compile in the folder of the study, unless told otherwise."""
    folder = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(out.resolve() / ".jax_cache"))
    seconds = os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float(seconds))
    files.remove_parts(Path(folder))


def write_whole() -> None:
    """Have JAX write what it keeps as all files of a study are written, and replace what is there already.

    JAX (up to 0.10 at least) writes a program in place and never again: another process may read half of it, and what
    a kill cut off is met with a warning, and compiled, at every start to come. It offers no seam for this, so the
    function that writes is exchanged; where it has another name, JAX is left as it is.
    """
    from jax._src import lru_cache

    cache: Any = getattr(lru_cache, "LRUCache", None)
    if cache is None or getattr(cache.put, "__module__", None) == __name__:
        return
    put_in_place = cache.put

    def put(self: Any, key: str, value: bytes) -> None:
        """Write one program; the arguments are those of `LRUCache.put`."""
        if self.eviction_enabled:  # JAX has a lock then
            put_in_place(self, key, value)
            return
        files.write(Path(self.path) / f"{key}{lru_cache._CACHE_SUFFIX}", value)

    cache.put = put
