"""The stage evolve, and neuro-evolution wherever a run needs it."""

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from qboot.envs.task import Domain
from qboot.neuroevolution.algorithms import ALGORITHMS, Algorithm, State
from qboot.neuroevolution.dnn import Genome
from qboot.neuroevolution.problem import EvolveInfo, Problem
from qboot.study.pipeline import loop
from qboot.study.pipeline.loop import Work
from qboot.study.pipeline.progress import Progress
from qboot.study.store import files
from qboot.study.store.artifacts import key_of, task_of
from qboot.study.store.output import Output
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class Evolving(NamedTuple):
    """Neuro-evolution in progress."""

    state: State
    history: dict[str, list]  # columns of history.csv


def evolve_stage(run: Run[RunSettings], output: Output, workers: int) -> None:
    """Neuro-evolution on the source set: history.csv, lineage.npz, pareto.npz."""
    problem = source_problem(run, workers)
    state = evolved(output, problem, run.settings.evolution.generations, "evolve", "history.csv")
    algorithm = algorithm_of(problem)
    output.write_npz("lineage.npz", files.to_arrays(algorithm.best_lineage(problem, state)))
    output.write_npz("pareto.npz", files.to_arrays(algorithm.pareto_front(state)))


def algorithm_of(problem: Problem) -> Algorithm:
    """The evolutionary algorithm that the settings name."""
    return ALGORITHMS[problem.settings.algorithm]


def source_problem(run: Run[RunSettings], workers: int) -> Problem:
    """The run's neuro-evolution on the source set."""
    return problem_on(run, task_of(run).source_domains(run.settings.source), "evolution", workers)


def problem_on(run: Run[RunSettings], domains: Domain, purpose: str, workers: int) -> Problem:
    """The run's neuro-evolution on a set of domains; `purpose` names its random stream."""
    settings = run.settings
    return Problem(task_of(run), domains, settings.evolution, settings.dnn, key_of(run, purpose), workers)


def evolved(
    output: Output,
    problem: Problem,
    generations: int,
    name: str,
    history_name: str,
    front: Genome | None = None,
    until_top: bool = False,
) -> State:
    """The end of an evolution of `generations`, checkpointed under `name`; its history is written when it is over.

    With `until_top` it is over, too, when it has the top score and cannot lose it: only the history counts, and that
    would go on level.
    """
    checkpoint = f"{name}.checkpoint.npz"
    algorithm = algorithm_of(problem)
    start = output.restored(checkpoint, partial(_restored, problem))
    if start is None:
        state, info = algorithm.init(problem, front)
        start = Evolving(state, {field: [value] for field, value in info._asdict().items()})
    top = problem.task.max_score_per_domain * len(jax.tree.leaves(problem.domains)[0])

    def done(evolving: Evolving) -> int:
        is_over = until_top and problem.settings.keeps_best and evolving.history["best"][-1] >= top
        return generations if is_over else evolving.state.generation

    def step(evolving: Evolving) -> Evolving:
        state, info = algorithm.step(problem, evolving.state)
        # A new history, not a longer one: what an interrupt saves is all of one generation.
        return Evolving(state, {field: [*evolving.history[field], value] for field, value in info._asdict().items()})

    with Progress(f"{name} {output.run.label}", "generation", generations, done(start)) as progress:
        work = Work(
            total=generations,
            done=done,
            step=step,
            save=lambda evolving: output.save(checkpoint, _saved(problem, evolving)),
            report=lambda evolving: progress.update(
                done(evolving),
                best=evolving.history["best"][-1],
                median=evolving.history["median"][-1],
                of=top,
            ),
        )
        end = loop.advance(work, start)
    output.write_csv(history_name, end.history)
    return end.state


def _saved(problem: Problem, evolving: Evolving) -> dict[str, np.ndarray]:
    history = {f"history.{name}": np.array(values) for name, values in evolving.history.items()}
    return files.to_arrays(algorithm_of(problem).condensed(evolving.state)) | history


def _restored(problem: Problem, arrays: dict[str, np.ndarray], origin: Path) -> Evolving:
    history = {name: files.pick(arrays, f"history.{name}", origin).tolist() for name in EvolveInfo._fields}
    algorithm = algorithm_of(problem)
    saved: Any = files.from_arrays(arrays, algorithm.saved, origin)
    return Evolving(algorithm.restored(problem, saved), history)
