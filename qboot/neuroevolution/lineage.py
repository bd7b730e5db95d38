"""Who descends from whom: the archive of ancestors, and the lineage of the best-of-run (paper, section IV-A)."""

from typing import NamedTuple

import jax
import numpy as np

from qboot.neuroevolution.dnn import Genome

NO_PARENT = -1


class Individuals(NamedTuple):
    """Genomes with their history, leading axis P; ids grow with time, so parents have smaller ids."""

    genomes: Genome
    ids: np.ndarray  # (P,) int64, unique in a run
    parents: np.ndarray  # (P,) int64 ids, NO_PARENT in the first generation
    births: np.ndarray  # (P,) int32 generation of birth
    scores: np.ndarray  # (P,) float32
    rooms: np.ndarray  # (P,) int32 room for hidden neurons that the scores come from: another rounds otherwise

    def take(self, index: np.ndarray | slice) -> "Individuals":
        """The individuals at `index`."""
        return jax.tree.map(lambda leaf: leaf[index], self)

    @staticmethod
    def concatenate(*groups: "Individuals") -> "Individuals":
        """All individuals of several groups, in order."""
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *groups)


def ancestors(archive: Individuals, ids: np.ndarray) -> np.ndarray:
    """Which of the archive (sorted by id) are individuals `ids` or their ancestors; (P,) bool.

    Parents come before children, so one pass from the youngest to the oldest marks them all.
    """
    keep = np.isin(archive.ids, ids)
    place = np.searchsorted(archive.ids, archive.parents)
    for i in range(len(keep) - 1, -1, -1):
        if keep[i] and archive.parents[i] != NO_PARENT:
            keep[place[i]] = True
    return keep


def lineage(archive: Individuals, best: int, horizon: int) -> Individuals:
    """The individual with id `best` and its ancestors, oldest first, the last `horizon` of them at most.

    Raises:
        ValueError: if the archive does not hold it.
    """
    if best not in archive.ids:
        raise ValueError(f"individual {best} is not in the archive of {len(archive.ids)} ancestors")
    chain: list[int] = []
    while best != NO_PARENT and len(chain) < horizon:
        place = int(np.searchsorted(archive.ids, best))
        chain.append(place)
        best = int(archive.parents[place])
    return archive.take(np.array(chain[::-1]))


def best_of(individuals: Individuals) -> int:
    """Id of the best individual; of several equals the youngest, whose lineage is the longest."""
    best = individuals.scores == individuals.scores.max()
    return int(individuals.ids[best].max())
