"""Many learners in one program: the cells of an ablation, padded to one shape, side by side under vmap.

Cells that are as far as each other run together. Each keeps its own checkpoint and its own results, so cells can be
interrupted, deleted and made again one by one.
"""

import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot import qlearning
from qboot.qlearning import Problem, input_set
from qboot.study import ablations, files, learning
from qboot.study.learning import Learning
from qboot.study.progress import Progress
from qboot.study.runs import Run
from qboot.study.stages import key_of, read_actions, read_selection, task_of

learn_side_by_side = jax.jit(jax.vmap(qlearning.learn, in_axes=(0, 0, None)), static_argnums=2)
"""`qlearning.learn` for stacked states and problems (leading axis)."""


class Shape(NamedTuple):
    """What all cells of an experiment are padded to."""

    n_actions: int
    n_inputs: int
    capacity: int  # decisions in a test at most


def learn_cells(cells: dict[Run, Run], workers: int) -> None:
    """Q-learning in all cells that are not done: qlearning.csv in the folder of each.

    Args:
        cells: all cells of one experiment, and the evolved run of each.
        workers: programs at a time, >= 1; they do not change results.
    """
    first = next(iter(cells)).settings
    for cell, evolved in cells.items():
        ablations.equip(cell, evolved)
    shape = shape_of(list(cells))
    pending = [cell for cell in cells if not cell.file("qlearning.csv").exists()]
    started = {cell: _begin(cell, shape) for cell in pending}
    done = {cell: first.episodes for cell in cells} | {
        cell: len(begun.history["episode"]) for cell, begun in started.items()
    }
    total = len(cells) * first.episodes
    with Progress(f"ablate {first.task} {first.what}", "episode", total, sum(done.values())) as progress:

        def report(cell: Run, episode: int) -> None:
            done[cell] = episode
            progress.update(sum(done.values()), cells=f"{sum(n == first.episodes for n in done.values())}/{len(done)}")

        blocks = _blocks(started, first.lanes)
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda block: _learn_block(block, shape, report), blocks))


def shape_of(cells: list[Run]) -> Shape:
    """The smallest shape that all cells fit into."""
    sets = [read_actions(cell) for cell in cells]
    shortest = min(int(actions.durations.min()) for actions in sets)
    return Shape(
        n_actions=max(len(actions.durations) for actions in sets),
        n_inputs=max(int(read_selection(cell).sum()) for cell in cells),
        capacity=-(-cells[0].settings.n_steps // shortest),
    )


def problem_of(cell: Run, shape: Shape) -> Problem:
    """What a cell learns, its actions and inputs padded."""
    actions = read_actions(cell)
    missing = shape.n_actions - len(actions.durations)
    padded = jax.tree.map(lambda leaf: np.pad(leaf, [(0, missing)] + [(0, 0)] * (leaf.ndim - 1)), actions)
    inputs = input_set(read_selection(cell), shape.n_inputs)
    task = task_of(cell)
    problem = Problem(task, cell.settings.learner, task.source_domains(cell.settings.source), padded, inputs)
    qlearning.check_problem(problem)
    return problem


def key_of_cell(cell: Run) -> jax.Array:
    """The random key of a cell: of its seed, and of its condition, so that conditions are independent samples."""
    name = f"{cell.settings.what} {cell.settings.condition}"
    return jax.random.fold_in(key_of(cell, "learning"), zlib.crc32(name.encode()))


def _blocks(started: dict[Run, Learning], lanes: int) -> list[dict[Run, Learning]]:
    """Cells that have done equally many episodes, at most `lanes` together."""
    by_episode: dict[int, list[Run]] = {}
    for cell, begun in started.items():
        by_episode.setdefault(len(begun.history["episode"]), []).append(cell)
    groups = [some[i : i + lanes] for some in by_episode.values() for i in range(0, len(some), lanes)]
    return [{cell: started[cell] for cell in group} for group in groups]


def _begin(cell: Run, shape: Shape) -> Learning:
    state = qlearning.init(key_of_cell(cell), problem_of(cell, shape), shape.capacity)
    return learning.begin(state, cell.file("learn.checkpoint.npz"))


def _learn_block(block: dict[Run, Learning], shape: Shape, report) -> None:
    """Learn in a block of cells, side by side, to their ends."""
    cells, begun = list(block), list(block.values())
    settings = cells[0].settings
    # A block that is not full repeats its last cell: results then do not depend on how cells fall into blocks.
    places = [min(i, len(cells) - 1) for i in range(settings.lanes)]
    problems = _stack([problem_of(cells[i], shape) for i in places])
    states = _stack([begun[i].state for i in places])
    done, saved = len(begun[0].history["episode"]), time.monotonic()
    for size in learning.call_sizes(done, settings.episodes):
        states, info = learn_side_by_side(states, problems, size)
        begun = [learning.after(each, _take(states, i), _take(info, i)) for i, each in enumerate(begun)]
        done += size
        is_over = done == settings.episodes
        if time.monotonic() > saved + learning.SECONDS_BETWEEN_SAVES and not is_over:
            for cell, each in zip(cells, begun, strict=True):
                learning.save(each, cell.file("learn.checkpoint.npz"))
            saved = time.monotonic()
        for cell, each in zip(cells, begun, strict=True):
            if is_over:
                files.write_csv(cell.file("qlearning.csv"), each.history)
                cell.file("learn.checkpoint.npz").unlink(missing_ok=True)
            report(cell, done)


def _stack(trees: list):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def _take(tree, index: int):
    return jax.tree.map(lambda leaf: leaf[index], tree)
