"""The stage evolve, and neuro-evolution wherever a run needs it."""

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
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


class Evolving(NamedTuple):
    """Neuro-evolution in progress."""

    state: State
    history: dict[str, list]  # columns of history.csv


def evolve_stage(run: Run[RunSettings], workers: int) -> None:
    """Neuro-evolution on the source set: history.csv, lineage.npz, pareto.npz."""
    problem = source_problem(run, workers)
    state = evolved(run, problem, run.settings.evolution.generations, "evolve", "history.csv")
    algorithm = algorithm_of(problem)
    files.write_npz(run.file("lineage.npz"), files.to_arrays(algorithm.best_lineage(problem, state)))
    files.write_npz(run.file("pareto.npz"), files.to_arrays(algorithm.pareto_front(state)))


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
    run: Run[RunSettings],
    problem: Problem,
    generations: int,
    name: str,
    history_name: str,
    front: Genome | None = None,
) -> State:
    """The end of an evolution of `generations`, checkpointed under `name`; its history is written when it is over."""
    checkpoint = run.file(f"{name}.checkpoint.npz")
    algorithm = algorithm_of(problem)
    if checkpoint.exists():
        start = _load(problem, checkpoint)
    else:
        state, info = algorithm.init(problem, front)
        start = Evolving(state, {field: [value] for field, value in info._asdict().items()})
    top = problem.task.max_score_per_domain * len(jax.tree.leaves(problem.domains)[0])

    def step(evolving: Evolving) -> Evolving:
        state, info = algorithm.step(problem, evolving.state)
        for field, value in info._asdict().items():
            evolving.history[field].append(value)
        return Evolving(state, evolving.history)

    with Progress(f"{name} {run.label}", "generation", generations, start.state.generation) as progress:
        work = Work(
            total=generations,
            done=lambda evolving: evolving.state.generation,
            step=step,
            save=lambda evolving: _save(problem, evolving, checkpoint),
            report=lambda evolving: progress.update(
                evolving.state.generation,
                best=evolving.history["best"][-1],
                median=evolving.history["median"][-1],
                of=top,
            ),
        )
        end = loop.advance(work, start)
    files.write_csv(run.file(history_name), end.history)
    return end.state


def _save(problem: Problem, evolving: Evolving, checkpoint: Path) -> None:
    history = {f"history.{name}": np.array(values) for name, values in evolving.history.items()}
    condensed = algorithm_of(problem).condensed(evolving.state)
    files.write_npz(checkpoint, files.to_arrays(condensed) | history)


def _load(problem: Problem, checkpoint: Path) -> Evolving:
    arrays = files.read_npz(checkpoint)
    history = {name: files.pick(arrays, f"history.{name}", checkpoint).tolist() for name in EvolveInfo._fields}
    algorithm = algorithm_of(problem)
    saved: Any = files.from_arrays(arrays, algorithm.saved, checkpoint)
    return Evolving(algorithm.restored(problem, saved), history)
