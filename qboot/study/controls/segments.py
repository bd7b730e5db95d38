"""The segments of an evolved run: each of its actions takes one, so they are as many as it can give."""

import functools

from qboot.extraction.segmentation import LONG_SEGMENTS, Segments
from qboot.study.pipeline import extracting
from qboot.study.store import files
from qboot.study.store.artifacts import read_arrays
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# What is done about long segments that leaves at least as many as there were.
_KEEPS = ("cut", "clip")


@functools.lru_cache(maxsize=1)
def segments_of(evolved: Run[RunSettings]) -> Segments:
    """All segments of an evolved run's traces, which are played again for it."""
    return extracting.segments_of(evolved, extracting.replayed(evolved, workers=1))


def recorded_number(evolved: Run[RunSettings]) -> int:
    """Segments that the traces were split into when actions were extracted, before what is done about long ones."""
    return int(files.pick(read_arrays(evolved, "actions.npz"), "n_segments", evolved.file("actions.npz")))


def shortage(evolved: Run[RunSettings], n_actions: int) -> str:
    """Why a run cannot give so many actions, in words; empty if it can. Only in doubt are its traces played again."""
    settings = evolved.settings.actions
    if recorded_number(evolved) >= n_actions and settings.long_segments in _KEEPS:
        return ""
    lengths = LONG_SEGMENTS[settings.long_segments](segments_of(evolved), settings.max_duration).durations
    return "" if len(lengths) >= n_actions else in_words(evolved, n_actions, len(lengths))


def in_words(evolved: Run[RunSettings], n_actions: int, n_segments: int) -> str:
    """What a run lacks, and what would help."""
    return (
        f"{n_actions} actions take as many segments, and the traces of {evolved.folder} have {n_segments}: "
        "more generations, a longer evolution.horizon or a larger n_steps give more"
    )
