"""Many learners in one program: the cells of a condition, padded to one shape, one by one or side by side under vmap.

Cells that are as far as each other run together. Each keeps its own checkpoint and its own results, so cells can be
interrupted, deleted and made again one by one.
"""

import contextlib
import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from qboot import qlearning
from qboot.keys import key
from qboot.qlearning import Problem, input_set
from qboot.qlearning.learner import EpisodeInfo, LearnerState
from qboot.study.controls import cells as folders
from qboot.study.controls.cells import Cell, Cells
from qboot.study.controls.shapes import Shape, shapes_of
from qboot.study.pipeline import learning, loop
from qboot.study.pipeline.extracting import ReplaysOtherwise
from qboot.study.pipeline.learning import Diverged, Learning
from qboot.study.pipeline.loop import Work
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files, lock, provenance
from qboot.study.store.artifacts import key_of, read_actions, read_selection, task_of
from qboot.study.store.files import RunError
from qboot.study.store.output import Output
from qboot.study.store.recipes import LEARN_CELL

Tree = TypeVar("Tree")

# Learners side by side in a program, unless told otherwise: on a CPU one by one is fastest (docs/performance.md).
LANES = 1
CHECKPOINT = "learn.checkpoint.npz"

_batched = jax.jit(jax.vmap(qlearning.learn, in_axes=(0, 0, None)), static_argnums=2)


def learn_side_by_side(
    states: list[LearnerState], problems: list[Problem], n_episodes: int
) -> list[tuple[LearnerState, EpisodeInfo]]:
    """What `qlearning.learn` gives for each of some learners of one shape, which learn in one program.

    One alone needs no axis of learners: batched, it would compute both branches of every condition.
    """
    if len(states) == 1:
        return [qlearning.learn(states[0], problems[0], n_episodes)]
    together = _batched(_stack(states), _stack(problems), n_episodes)
    return [_take(together, i) for i in range(len(states))]


def learn_cells(cells: Cells, workers: int) -> None:
    """Q-learning in all cells that are not done: qlearning.csv in the folder of each.

    Args:
        cells: all cells of one experiment, and the evolved run of each.
        workers: programs at a time, >= 1; they do not change results.

    Raises:
        Diverged: if learners diverged, when the others are done.
        RunError: if some have to be equipped from a lineage that replays otherwise on this machine, when the others are
            done; at once if another process learns in these cells.
    """
    # Cells that are done may be read by others at the same time.
    owned = [cell for cell, evolved in cells.items() if not folders.is_finished(cell, evolved)]
    with contextlib.ExitStack() as stack:
        for folder in sorted({cell.folder.parents[1] for cell in owned}):
            stack.enter_context(lock.owned(folder))
        _learn_cells(cells, owned, workers)


def _learn_cells(cells: Cells, owned: list[Cell], workers: int) -> None:
    unequipped: dict[Cell, str] = {}
    for cell in owned:
        try:
            folders.equip(cell, cells[cell])
        except ReplaysOtherwise as error:  # where it was evolved, the cell can be had
            unequipped[cell] = str(error)
    ready = [cell for cell in cells if cell not in unequipped]
    shapes = shapes_of(ready)
    pending = [cell for cell in owned if cell in shapes and not provenance.is_whole(cell, "qlearning.csv")]
    for cell in pending:
        files.remove_parts(cell.folder)  # who owns the experiment owns its cells
        provenance.set_aside_faulty(cell, LEARN_CELL)
    started = {cell: _begin(cell, shapes[cell]) for cell in pending}
    done = {cell: cell.settings.episodes for cell in ready} | {cell: begun.episodes for cell, begun in started.items()}
    total = sum(cell.settings.episodes for cell in ready)
    first = next(iter(cells))
    label = f"ablate {first.task_name} {first.settings.what}"
    with Progress(label, "episode", total, sum(done.values())) as progress:

        def report(some: list[Cell], episode: int) -> None:
            done.update(dict.fromkeys(some, episode))
            progress.update(
                sum(done.values()), cells=f"{sum(n == cell.settings.episodes for cell, n in done.items())}/{len(done)}"
            )

        blocks = _blocks(started, shapes, first.settings.lanes)
        with ThreadPoolExecutor(workers) as pool:
            diverged = list(pool.map(lambda block: _learn_block(block, shapes[next(iter(block))], report), blocks))
    if words := [*dict.fromkeys(unequipped.values()), *itertools.chain.from_iterable(diverged)]:
        raise (RunError if unequipped else Diverged)("; ".join(words))


def problem_of(cell: Cell, shape: Shape) -> Problem:
    """What a cell learns, its actions and inputs padded."""
    actions = read_actions(cell)
    missing = shape.n_actions - len(actions.durations)
    actions = jax.tree.map(lambda leaf: np.pad(leaf, [(0, missing)] + [(0, 0)] * (leaf.ndim - 1)), actions)
    inputs = input_set(read_selection(cell), shape.n_inputs)
    task = task_of(cell)
    problem = Problem(task, cell.settings.learner, task.source_domains(cell.settings.source), actions, inputs)
    qlearning.check_problem(problem)
    return problem


def key_of_cell(cell: Cell) -> jax.Array:
    """The random key of a cell: of its seed, and of its condition, so that conditions are independent samples."""
    return key(key_of(cell, "learning"), f"{cell.settings.what} {cell.settings.condition}")


def _blocks(started: dict[Cell, Learning], shapes: dict[Cell, Shape], lanes: int) -> list[dict[Cell, Learning]]:
    """Cells of one shape that have done equally many of as many episodes, at most `lanes` together."""
    alike: dict[tuple, list[Cell]] = {}
    for cell, begun in started.items():
        alike.setdefault((shapes[cell], begun.episodes, cell.settings.episodes), []).append(cell)
    groups = [some[i : i + lanes] for some in alike.values() for i in range(0, len(some), lanes)]
    return [{cell: started[cell] for cell in group} for group in groups]


def _begin(cell: Cell, shape: Shape) -> Learning:
    state = qlearning.init(key_of_cell(cell), problem_of(cell, shape), shape.capacity)
    return Output(cell, LEARN_CELL).restored(CHECKPOINT, partial(learning.restored, state)) or learning.begin(state)


def _learn_block(begun: dict[Cell, Learning], shape: Shape, report: Callable[[list[Cell], int], None]) -> list[str]:
    """Learn in a block of cells, side by side, to their ends; a line for each that diverged, others go on."""
    cells = list(begun)
    settings = cells[0].settings
    problems = [problem_of(cell, shape) for cell in cells]
    # A block that is not full repeats its last cell: results then do not depend on how cells fall into blocks.
    places = [min(i, len(cells) - 1) for i in range(settings.lanes)]

    def step(block: list[Learning]) -> list[Learning]:
        size = learning.call_size(block[0].episodes, settings.episodes)
        found = learn_side_by_side([block[i].state for i in places], [problems[i] for i in places], size)
        return [learning.after(each, *new) for each, new in zip(block, found, strict=False)]

    def save(block: list[Learning]) -> None:
        for cell, each in zip(cells, block, strict=True):
            if not learning.divergence(each, settings.learner):
                Output(cell, LEARN_CELL).save(CHECKPOINT, learning.saved(each))

    work = Work(
        total=settings.episodes,
        done=lambda block: block[0].episodes,
        step=step,
        save=save,
        report=lambda block: report(cells, block[0].episodes),
    )
    end = loop.advance(work, list(begun.values()))
    diverged = []
    for cell, each in zip(cells, end, strict=True):
        output = Output(cell, LEARN_CELL)
        if words := learning.divergence(each, settings.learner):
            learning.keep_diverged(output, "qlearning.csv", each)
            diverged.append(f"{cell.folder}: {words}")
        else:
            output.write_csv("qlearning.csv", each.history)
            files.remove(cell.file(CHECKPOINT))
    return diverged


def _stack(trees: list[Tree]) -> Tree:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def _take(tree: Tree, index: int) -> Tree:
    return jax.tree.map(lambda leaf: leaf[index], tree)
