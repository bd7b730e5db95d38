"""Rollouts as moving pictures with a slider, drawn in the browser on a canvas from numbers in the page."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qboot.envs.scene import Scene, Shape
from qboot.envs.task import Task
from qboot.study.analysis import recordings
from qboot.study.analysis.recordings import Recording
from qboot.study.report.templating import PAGES
from qboot.study.store import files
from qboot.study.store.artifacts import task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# Frames of one rollout, and of all on a page, at most: evenly spaced timesteps are kept, which bounds a page's size.
MAX_FRAMES, MAX_FRAMES_OF_PAGE = 2_000, 40_000
WHO = ("Best network", "Q-policy")


class Replay(NamedTuple):
    """Two rollouts from the same start."""

    title: str  # which rollout, and what the two scored
    data: list[dict]  # what templates/player.js draws, for each of WHO


class Player(NamedTuple):
    """A moving picture of the best network and one of the Q-policy, side by side, of any of the rollouts."""

    who: tuple[str, ...]
    legend: dict[str, str]  # label to colour
    replays: list[Replay]


def write(run: Run[RunSettings]) -> Path:
    """Write RUN/replay.html, the best network and the Q-policy in each source domain; a self-contained page.

    Raises:
        RunError: if the stages evolve, extract or learn have not been run, or the task does not say how it is drawn.
    """
    path = run.file("replay.html")
    page = PAGES.get_template("players.html.jinja").render(run=run, player=player(run))
    files.write_text(path, page)
    return path


def player(run: Run[RunSettings]) -> Player:
    """The player of a run: all rollouts of an episode on the source set.

    Raises:
        RunError: as `write` does.
    """
    task = task_of(run)
    if task.view is None:
        raise RunError(f"{task.name} does not say how it is drawn: give its Task a `view`")
    view = task.view
    pairs = list(zip(recordings.evolved(run), recordings.learned(run), strict=True))
    max_frames = min(MAX_FRAMES, max(2, MAX_FRAMES_OF_PAGE // (2 * len(pairs))))
    replays: list[Replay] = []
    legend: dict[str, str] = {}
    for place, pair in enumerate(pairs):
        scenes = [view.scene(recording.domain, recording.states) for recording in pair]
        data = [as_data(task, *each, max_frames) for each in zip(pair, scenes, strict=True)]
        replays.append(Replay(_title(task, place, pair), data))
        legend |= {label: colour for scene in scenes for label, colour in scene.legend.items()}
    return Player(WHO, legend, replays)


def _title(task: Task, place: int, pair: tuple[Recording, Recording]) -> str:
    domain, rollout = divmod(place, task.rollouts_per_domain)
    network, policy = (f"{recordings.scores(task, recording)[-1]:g}" for recording in pair)
    which = f"domain {domain}, rollout {rollout}" if task.rollouts_per_domain > 1 else f"domain {domain}"
    return f"{which}: network {network}, Q-policy {policy}"


def as_data(task: Task, recording: Recording, scene: Scene, max_frames: int = MAX_FRAMES) -> dict:
    """A scene of F frames as plain values for the page, thinned to `max_frames`.

    Flags are lists of the frames at which they change, beginning from false: few numbers, for they seldom do. So is
    the score, beginning from 0, with what it changes to.
    """
    n_states = len(recording.states.reward)
    kept = np.unique(np.linspace(0, n_states - 1, min(max_frames, n_states)).round().astype(int))
    digits = 3 - math.floor(math.log10(abs(scene.right - scene.left)))
    scores = recordings.scores(task, recording)[kept].round(3)
    changed = np.flatnonzero(np.diff(scores, prepend=0))
    return {
        "box": [scene.left, scene.top, scene.right, scene.bottom],
        "steps": kept.tolist(),
        "scored": changed.tolist(),
        "scores": [round(float(score), 3) for score in scores[changed]],
        "actions": recording.actions[kept[1:] - 1].tolist() if len(recording.actions) else [],
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
