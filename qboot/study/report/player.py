"""Replays in the browser: a test as a moving picture with a slider, drawn on a canvas from numbers in the page."""

import math
from pathlib import Path
from typing import NamedTuple

import jinja2
import numpy as np

from qboot.envs.task import Task
from qboot.study.analysis import recordings
from qboot.study.analysis.recordings import Recording
from qboot.study.figures.catalogue.scenes import LOOKS, Scene, Shape
from qboot.study.pipeline.stages import task_of
from qboot.study.store import files
from qboot.study.store.runs import Run

# Frames of one test at most: evenly spaced steps are kept, which bounds the size of a page.
MAX_FRAMES = 2_000

PAGES = jinja2.Environment(
    loader=jinja2.PackageLoader("qboot.study.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
)


class Player(NamedTuple):
    """One moving picture."""

    title: str
    legend: dict[str, str]  # label to colour
    data: dict  # what templates/replay.js draws


def write(run: Run) -> Path:
    """Write RUN/replay.html, the best network and the Q-policy in each source domain; a self-contained page.

    Raises:
        RunError: if the stages evolve, extract or learn have not been run.
    """
    path = run.file("replay.html")
    page = PAGES.get_template("replay.html.jinja").render(run=run, players=players(run))
    files.write_text(path, page)
    return path


def players(run: Run) -> list[Player]:
    """The pictures of a run: per source domain the best evolved network, then the greedy Q-policy."""
    pairs = zip(recordings.evolved(run), recordings.learned(run), strict=True)
    return [
        _player(f"{who}, source domain {place}", run, recording)
        for place, pair in enumerate(pairs)
        for who, recording in zip(("Best network", "Q-policy"), pair, strict=True)
    ]


def _player(title: str, run: Run, recording: Recording) -> Player:
    scene = LOOKS[run.settings.task].scene(recording.domain, recording.states)
    return Player(title, scene.legend, as_data(task_of(run), recording, scene))


def as_data(task: Task, recording: Recording, scene: Scene, max_frames: int = MAX_FRAMES) -> dict:
    """A scene of F frames as plain values for the page, thinned to `max_frames`.

    Flags are lists of the frames at which they change, beginning from false: few numbers, for they seldom do.
    """
    n_states = len(recording.states.reward)
    kept = np.unique(np.linspace(0, n_states - 1, min(max_frames, n_states)).round().astype(int))
    digits = 3 - math.floor(math.log10(abs(scene.right - scene.left)))
    scored = recordings.scores(task, recording)[kept].round().astype(int)
    return {
        "box": [scene.left, scene.top, scene.right, scene.bottom],
        "steps": kept.tolist(),
        "scores": np.repeat(np.arange(len(kept)), np.diff(scored, prepend=0)).tolist(),
        "actions": [] if recording.actions is None else recording.actions[kept[1:] - 1].tolist(),
        "shapes": [_shape_data(shape, kept, digits) for shape in scene.shapes],
        "movers": [place for place, shape in enumerate(scene.shapes) if any(shape is mover for mover in scene.movers)],
    }


def _shape_data(shape: Shape, kept: np.ndarray, digits: int) -> dict:
    def thinned(values: np.ndarray) -> np.ndarray:
        return values if len(values) == 1 else np.asarray(values)[kept]

    def numbers(values: np.ndarray, digits: int) -> list[float]:
        return [round(float(value), digits) for value in thinned(values)]

    def changes(flags: np.ndarray) -> list[int]:
        return np.flatnonzero(np.diff(thinned(flags), prepend=False)).tolist()

    data = {
        "x": numbers(shape.x, digits),
        "y": numbers(shape.y, digits),
        "halfWidth": round(shape.half_width, digits),
        "colour": shape.colour,
        "activeColour": shape.active_colour,
    }
    if shape.half_height is not None:
        data["halfHeight"] = round(shape.half_height, digits)
    if shape.heading is not None:
        data["heading"] = numbers(shape.heading, 2)
    for name in ("visible", "active"):
        flags = getattr(shape, name)
        if flags is not None:
            data[name] = changes(flags)
    return data
