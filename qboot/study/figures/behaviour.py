"""Figures of behaviour: the domains (4, 11), the best network's path (5, 12), the Q-policy's path (7, 13)."""

import jax
import numpy as np
from matplotlib.axes import Axes

from qboot.extraction.actions import ActionSet
from qboot.study.analysis import recordings
from qboot.study.analysis.recordings import Recording
from qboot.study.figures.catalogue.drawing import Drawn, draw_path, draw_scene, hide_unused, legend_patches, new_figure
from qboot.study.figures.catalogue.extraction import best_run
from qboot.study.figures.catalogue.scenes import BLUE, GREEN, LOOKS, PURPLE, RED, Scene, Shape
from qboot.study.pipeline.stages import read_actions, task_of
from qboot.study.store.runs import Run

ACTION_COLOURS = (RED, BLUE, GREEN, PURPLE, "#56b4e9", "#e69f00", "#000000", "#8c564b")
OTHER = "#c8c8c8"
ACTIVE_WIDTH, WIDTH = 2.4, 1.0  # of a path, in points
COLUMNS = 4


def domains(runs: list[Run]) -> Drawn:
    """Figures 4 and 11: the domains at the start of a test; what is not there yet is hollow."""
    task, look = task_of(runs[0]), LOOKS[runs[0].settings.task]
    drawn = []
    for name, domain in look.domains():
        state = task.reset(jax.random.key(0), domain)
        states = jax.tree.map(lambda leaf: np.asarray(leaf)[None], state)
        drawn.append((name, look.scene(domain, states)))
    figure, axes = new_figure(-(-len(drawn) // 3), 3, 7.5, 2.7 * -(-len(drawn) // 3))
    for panel, (name, scene) in zip(axes.flat, drawn, strict=False):
        draw_scene(panel, scene)
        panel.set_title(name)
    hide_unused(axes, len(drawn))
    at_start = {shape.label: shape.colour for shape in drawn[0][1].shapes}
    figure.legend(handles=legend_patches(at_start), loc="outside lower center", ncol=6)
    return Drawn(figure, look.note, [])


def evolved_behaviour(runs: list[Run]) -> Drawn:
    """Figures 5 and 12: path of the best network in its source domains, another colour where it is active."""
    run = best_run(runs, "lineage.npz")
    found = recordings.evolved(run)
    scenes = [_scene(run, recording) for recording in found]
    figure, axes = new_figure(1, len(scenes), 4.0 * len(scenes), 4.7)
    for panel, scene in zip(axes.flat, scenes, strict=True):
        draw_scene(panel, scene)
        for mover in scene.movers:
            draw_path(panel, mover, np.where(mover.active[1:], mover.active_colour, mover.colour).tolist())
    figure.legend(handles=legend_patches(scenes[0].legend), loc="outside lower center", ncol=4)
    return Drawn(figure, f"The best network of {run.label}: {_told(run, found)}.", [run.label])


def learned_behaviour(runs: list[Run]) -> Drawn:
    """Figures 7 and 13: path of the Q-policy, coloured by the action in force, and a panel for each used action."""
    run = best_run(runs, "lineage.npz", "qnets.npz")
    found, actions = recordings.learned(run), read_actions(run)
    used = _most_used(found)
    colours = {action: ACTION_COLOURS[place] for place, action in enumerate(used)}
    scenes = [_scene(run, recording) for recording in found]
    rows = -(-(len(scenes) + len(used)) // COLUMNS)
    figure, axes = new_figure(rows, COLUMNS, 11.0, 3.5 * rows + 0.5)
    for panel, recording, scene in zip(axes.flat, found, scenes, strict=False):
        draw_scene(panel, scene)
        in_force = [colours.get(int(action), OTHER) for action in recording.actions]
        for mover in scene.movers:
            draw_path(panel, mover, in_force, _widths(mover))
        panel.set_title("all actions")
    for panel, action in zip(axes.flat[len(scenes) :], used, strict=False):
        place = int(np.argmax([(recording.actions == action).sum() for recording in found]))
        _draw_action(panel, found[place], scenes[place], action, colours[action])
        panel.set_title(_command_text(actions, action, task_of(run).effectors), fontsize=9, fontweight="normal")
    hide_unused(axes, len(scenes) + len(used))
    entries = {f"action {action}": colour for action, colour in colours.items()}
    figure.legend(handles=legend_patches(entries | {"other actions": OTHER}), loc="outside lower center", ncol=9)
    n_used = len(np.unique(np.concatenate([recording.actions for recording in found])))
    shows = (
        f"The Q-policy of {run.label}: {_told(run, found)}. In use: {n_used} of its {len(actions.durations)} actions; "
        f"coloured: the {len(used)} most frequent. Then each of these on the path where it is longest in force, with "
        f"its commands from its first step to its last. A wide line: {scenes[0].movers[0].active_label}."
    )
    return Drawn(figure, shows, [run.label])


def _scene(run: Run, recording: Recording) -> Scene:
    return LOOKS[run.settings.task].scene(recording.domain, recording.states)


def _told(run: Run, found: list[Recording]) -> str:
    """Scores and lengths of tests in words."""
    task = task_of(run)
    return ", ".join(
        f"{recordings.scores(task, recording)[-1]:g} in {len(recording.states.reward) - 1:,} steps of domain {place}"
        for place, recording in enumerate(found)
    )


def _most_used(found: list[Recording]) -> list[int]:
    """Actions by how long they were in force, longest first, as many as there are colours."""
    actions, steps = np.unique(np.concatenate([recording.actions for recording in found]), return_counts=True)
    return actions[np.argsort(-steps, kind="stable")][: len(ACTION_COLOURS)].tolist()


def _widths(mover: Shape) -> np.ndarray:
    return np.where(mover.active[1:], ACTIVE_WIDTH, WIDTH)


def _draw_action(axes: Axes, recording: Recording, scene: Scene, action: int, colour: str) -> None:
    """The path, coloured where one action is in force."""
    draw_scene(axes, scene)
    in_force = np.where(recording.actions == action, colour, "none").tolist()
    for mover in scene.movers:
        draw_path(axes, mover, OTHER, 0.8)
        draw_path(axes, mover, in_force, 1.5 * _widths(mover))


def _command_text(actions: ActionSet, action: int, effectors: tuple[str, ...]) -> str:
    """What an action commands, from its first step to its last, clipped to [0, 1]."""
    steps = int(actions.durations[action])
    first = np.asarray(actions.intercepts[action])
    last = first + np.asarray(actions.slopes[action]) * (steps - 1)
    lines = [
        f"{name.replace('_', ' ')} {start:.2f} to {end:.2f}"
        for name, start, end in zip(effectors, first.clip(0, 1), last.clip(0, 1), strict=True)
    ]
    return "\n".join([f"action {action}: {steps} steps", *lines])
