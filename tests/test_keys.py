"""Random streams by name."""

import itertools
import zlib

import jax
import numpy as np

from qboot.keys import key, keys

ROOT = jax.random.key(7)


def data(some):
    return jax.random.key_data(some).tolist()


def test_a_stream_is_its_name_folded_into_the_root():
    # The checksum of the name, from its published test vector.
    assert zlib.crc32(b"123456789") == 0xCBF43926
    assert data(key(ROOT, "123456789")) == data(jax.random.fold_in(ROOT, 0xCBF43926))


def test_numbered_keys_are_those_of_the_stream():
    numbers = np.array([5, 0, 2**31, 2**32 - 1])
    expected = [data(jax.random.fold_in(key(ROOT, "mutation"), np.uint32(n))) for n in numbers]
    assert data(keys(ROOT, "mutation", numbers)) == expected


def test_names_give_different_streams():
    names = ("diversity", "first", "tournament", "mutation", "evaluation", "learning", "actions")
    for one, two in itertools.combinations(names, 2):
        assert data(key(ROOT, one)) != data(key(ROOT, two))
