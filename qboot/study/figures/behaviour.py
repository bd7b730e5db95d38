"""Figures of behaviour: the best network's path (figures 5 and 12 of the paper), the Q-policy's path (7, 13)."""

import numpy as np
from matplotlib.axes import Axes

from qboot.envs.scene import BLUE, GREEN, ORANGE, PURPLE, RED, SKY, Scene, Shape
from qboot.extraction.actions import ActionSet
from qboot.study.analysis import recordings
from qboot.study.analysis.gathering import best_run
from qboot.study.analysis.recordings import Recording
from qboot.study.figures.drawing import Drawn, draw_path, draw_scene, grid_of, is_active, legend_patches
from qboot.study.store.artifacts import read_actions, task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

ACTION_COLOURS = (RED, BLUE, GREEN, PURPLE, SKY, ORANGE, "#000000", "#8c564b")
OTHER = "#c8c8c8"
ACTIVE_WIDTH, WIDTH = 2.4, 1.0  # of a path, in points
COLUMNS = 4


def evolved_behaviour(runs: list[Run[RunSettings]]) -> Drawn:
    """Path of the best network in its source domains, another colour where it is active."""
    run = best_run(runs, "lineage.npz")
    found = recordings.first_of_domains(task_of(run), recordings.evolved(run))
    scenes = [_scene(run, recording) for recording in found]
    figure, panels = grid_of(len(scenes), COLUMNS, 4.0, 4.2, margin=0.5)
    for panel, scene in zip(panels, scenes, strict=True):
        draw_scene(panel, scene)
        for mover in scene.movers:
            draw_path(panel, mover, np.where(is_active(mover), mover.active_colour, mover.colour).tolist())
    figure.legend(handles=legend_patches(scenes[0].legend), loc="outside lower center", ncol=4)
    return Drawn(figure, f"The best network of {run.label}: {_told(run, found)}.", [run.label])


def learned_behaviour(runs: list[Run[RunSettings]]) -> Drawn:
    """Path of the Q-policy, coloured by the action in force, and a panel for each used action."""
    run = best_run(runs, "lineage.npz", "qnets.npz")
    found, actions = recordings.first_of_domains(task_of(run), recordings.learned(run)), read_actions(run)
    used = _most_used(found)
    colours = {action: ACTION_COLOURS[place] for place, action in enumerate(used)}
    scenes = [_scene(run, recording) for recording in found]
    figure, panels = grid_of(len(scenes) + len(used), COLUMNS, 2.75, 3.5, margin=0.5)
    for panel, recording, scene in zip(panels, found, scenes, strict=False):
        draw_scene(panel, scene)
        in_force = [colours.get(int(action), OTHER) for action in recording.actions]
        for mover in scene.movers:
            draw_path(panel, mover, in_force, _widths(mover))
        panel.set_title("all actions")
    for panel, action in zip(panels[len(scenes) :], used, strict=True):
        place = int(np.argmax([(recording.actions == action).sum() for recording in found]))
        _draw_action(panel, found[place], scenes[place], action, colours[action])
        panel.set_title(_command_text(actions, action, task_of(run).effectors), fontsize=9, fontweight="normal")
    entries = {f"action {action}": colour for action, colour in colours.items()}
    figure.legend(handles=legend_patches(entries | {"other actions": OTHER}), loc="outside lower center", ncol=9)
    n_used = len(np.unique(np.concatenate([recording.actions for recording in found])))
    shows = (
        f"The Q-policy of {run.label}: {_told(run, found)}. In use: {n_used} of its {len(actions.durations)} actions; "
        f"coloured: the {len(used)} most frequent. Then each of these on the path where it is longest in force, with "
        "its commands from its first timestep to its last."
    )
    wide = dict.fromkeys(mover.active_label for mover in scenes[0].movers if mover.active_label)
    return Drawn(figure, shows + "".join(f" A wide line: {label}." for label in wide), [run.label])


def _scene(run: Run[RunSettings], recording: Recording) -> Scene:
    view = task_of(run).view
    assert view is not None, "not in this task's catalogue"
    return view.scene(recording.domain, recording.states)


def _told(run: Run[RunSettings], found: list[Recording]) -> str:
    """Scores and lengths of rollouts in words."""
    task = task_of(run)
    return ", ".join(
        f"{recordings.scores(task, recording)[-1]:g} in {len(recording.states.reward) - 1:,} timesteps "
        f"of domain {place}"
        for place, recording in enumerate(found)
    )


def _most_used(found: list[Recording]) -> list[int]:
    """Actions by how long they were in force, longest first, as many as there are colours."""
    actions, steps = np.unique(np.concatenate([recording.actions for recording in found]), return_counts=True)
    return actions[np.argsort(-steps, kind="stable")][: len(ACTION_COLOURS)].tolist()


def _widths(mover: Shape) -> np.ndarray:
    return np.where(is_active(mover), ACTIVE_WIDTH, WIDTH)


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
