"""Figures of a task itself: its environment (figure 10 of the paper) and its domains (4, 11)."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from qboot.envs.task import Domain, TaskState
from qboot.study.figures.drawing import Drawn, draw_scene, grid_of, legend_patches
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

COLUMNS = 3


def environment(runs: list[Run[RunSettings]]) -> Drawn:
    """The task's own picture of its robot."""
    task = task_of(runs[0])
    assert task.view is not None and task.view.picture is not None, "not in this task's catalogue"
    figure, shows = task.view.picture(task)
    return Drawn(figure, shows, [])


def domains(runs: list[Run[RunSettings]]) -> Drawn:
    """The domains at the start of a rollout; what is not there yet is hollow."""
    task = task_of(runs[0])
    assert task.view is not None, "not in this task's catalogue"
    reset = jax.jit(task.reset)  # one program for all domains
    scenes = [(name, task.view.scene(domain, _start(reset, domain))) for name, domain in task.view.domains()]
    figure, panels = grid_of(len(scenes), COLUMNS, 2.5, 2.7)
    for panel, (name, scene) in zip(panels, scenes, strict=True):
        draw_scene(panel, scene)
        panel.set_title(name)
    at_start = {shape.label: shape.colour for _, scene in scenes for shape in scene.shapes}
    figure.legend(handles=legend_patches(at_start), loc="outside lower center", ncol=6)
    return Drawn(figure, task.view.note, [])


def _start(reset: Callable[[jax.Array, Domain], TaskState], domain: Domain) -> Any:
    """The first state of a rollout, as a recording of one frame."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[None], reset(jax.random.key(0), domain))
