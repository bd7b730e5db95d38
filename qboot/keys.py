"""Random keys by name: a stream depends on its name alone, so a new one changes none of the others."""

import zlib
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np


def key(root: jax.Array, name: str) -> jax.Array:
    """The random key () of the stream `name` below the key `root` ()."""
    return jax.random.fold_in(root, zlib.crc32(name.encode()))


def named(root: jax.Array, names: Sequence[str]) -> jax.Array:
    """The random keys (n,) of the streams `names`, n of them, each as `key` gives it."""
    return _fold_in(root, jnp.array([zlib.crc32(name.encode()) for name in names], jnp.uint32))


def keys(root: jax.Array, name: str, numbers: np.ndarray | jax.Array) -> jax.Array:
    """The random keys (n,) of the stream `name`, one for each of `numbers` (n,), integers below 2**32."""
    return _fold_in(key(root, name), jnp.asarray(numbers, jnp.uint32))


_fold_in = jax.jit(jax.vmap(jax.random.fold_in, in_axes=(None, 0)))
