"""Sets of domains by the name of their source, from what people write down: numbers, lists, arrays, mappings."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from qboot.envs.task import Domain


class Sets(dict):
    """Sets of domains by name of their source; compared as objects, so that tasks can be static arguments."""

    __hash__ = object.__hash__  # type: ignore[assignment]
    __eq__ = object.__eq__


def set_of(name: str, sets: Mapping[str, Domain], source: str) -> Domain:
    """The set of a source.

    Raises:
        ValueError: for an unknown source; `name` is the task's.
    """
    if source not in sets:
        raise ValueError(f"unknown source {source!r} of {name}: choose one of {', '.join(sets)}")
    return sets[source]


def all_domains(source: Mapping[str, Domain], target: Mapping[str, Domain]) -> list[tuple[str, Domain]]:
    """All domains with names, each once."""
    found = []
    for kind, sets in (("source", source), ("target", target)):
        for name, domains in sets.items():
            for place in range(len(jax.tree.leaves(domains)[0])):
                label = f"{kind} {place}" if len(sets) == 1 else f"{kind} {place} of {name}"
                found.append((label, jax.tree.map(lambda leaf, place=place: leaf[place], domains)))
    return found


def sets_by_name(source: Any, target: Any) -> tuple[tuple[str, ...], dict[str, Domain], dict[str, Domain]]:
    """Names of the sources, and their source and target sets as arrays; a set without a name is source "A".

    Raises:
        ValueError: if the two name different sources, or a set has no leading axis.
    """
    both = [_as_mapping(some) for some in (source, target)]
    if set(both[0]) != set(both[1]):
        raise ValueError(f"source and target must name the same sources, got {sorted(both[0])} and {sorted(both[1])}")
    return tuple(both[0]), both[0], both[1]


def _as_mapping(domains: Any) -> dict[str, Domain]:
    by_name = domains if isinstance(domains, Mapping) else {"A": domains}
    return {name: _as_arrays(some) for name, some in by_name.items()}


def _as_arrays(domains: Any) -> Domain:
    """A set of domains as NumPy arrays with a leading axis D; a list or range of numbers is one array."""
    is_plain = isinstance(domains, (list, range)) or (isinstance(domains, tuple) and not hasattr(domains, "_fields"))
    arrays = np.asarray(domains) if is_plain else jax.tree.map(np.asarray, domains)
    narrow = {"i": np.int32, "u": np.uint32, "f": np.float32}
    arrays = jax.tree.map(lambda leaf: leaf.astype(narrow.get(leaf.dtype.kind, leaf.dtype)), arrays)
    lengths = {leaf.shape[:1] for leaf in jax.tree.leaves(arrays)}
    if len(lengths) != 1 or lengths in ({()}, {(0,)}):
        raise ValueError(f"a set of domains has one leading axis, at least 1 long, on all its arrays: got {lengths}")
    return arrays


def are_seeds(domains: Domain) -> bool:
    """Whether domains are whole numbers (D,)."""
    return isinstance(domains, np.ndarray) and domains.ndim == 1 and domains.dtype.kind in "iu"
