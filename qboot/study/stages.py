"""The stages of a run: each reads and writes files of a run folder, skips what is done, resumes what was interrupted.

evolve -> extract -> learn -> transfer. What a stage makes depends on the run's settings alone, never on how often it
was interrupted or how many workers it had.
"""

import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

from qboot.envs import make_task
from qboot.envs.types import Domain, Task
from qboot.extraction.actions import ActionSet, cluster_actions
from qboot.extraction.segmentation import Segments, segment
from qboot.extraction.sensors import select
from qboot.extraction.traces import Trace, traces
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.algorithms import ALGORITHMS, Algorithm, State
from qboot.neuroevolution.dnn import Genome
from qboot.neuroevolution.lineage import Individuals
from qboot.neuroevolution.problem import EvolveInfo, Problem
from qboot.neuroevolution.recorders import STATES
from qboot.qlearning import learner, policy
from qboot.qlearning.inputs import InputSet, input_set
from qboot.qlearning.networks import QNetworks
from qboot.study import files, learning
from qboot.study.files import RunError
from qboot.study.progress import Progress
from qboot.study.runs import Run

_PURPOSES = (
    "evolution",
    "actions",
    "learning",
    "target_learning",
    "target_er",
    "target_er_transfer",
    "tests",
)
# What each stage writes, in their order.
FILES = {
    "evolve": ("history.csv", "lineage.npz", "pareto.npz"),
    "extract": ("actions.npz", "sensors.npz"),
    "learn": ("learn.checkpoint.npz", "qlearning.csv", "qnets.npz"),
    "transfer": (
        "generalisation.csv",
        *(
            f"{part}.{ending}"
            for part in ("target_learn", "target_er", "target_er_transfer")
            for ending in ("checkpoint.npz", "csv")
        ),
        "transfer.csv",
    ),
}
GENOMES = Genome(*range(len(Genome._fields)))
INDIVIDUALS = Individuals(GENOMES, 0, 0, 0, 0)


def task_of(run: Run) -> Task:
    """The run's task, with its tests as long as the settings say."""
    return make_task(run.settings.task, run.settings.physics)._replace(max_steps=run.settings.n_steps)


def key_of(run: Run, purpose: str) -> jax.Array:
    """The random key of one purpose within the run."""
    return jax.random.fold_in(jax.random.key(run.settings.seed), _PURPOSES.index(purpose))


def source_problem(run: Run, workers: int) -> Problem:
    """The run's neuro-evolution on the source set."""
    return _problem(run, task_of(run).source_domains(run.settings.source), "evolution", workers)


def evolve_stage(run: Run, workers: int) -> None:
    """Neuro-evolution on the source set: history.csv, lineage.npz, pareto.npz."""
    if run.file("pareto.npz").exists():
        return
    _forget_after(run, "evolve")
    problem = source_problem(run, workers)
    state = _evolved(run, problem, run.settings.evolution.generations, "evolve", "history.csv")
    algorithm = _algorithm(problem)
    files.write_npz(run.file("lineage.npz"), files.to_arrays(algorithm.best_lineage(problem, state)))
    files.write_npz(run.file("pareto.npz"), files.to_arrays(algorithm.pareto_front(state)))
    run.file("evolve.checkpoint.npz").unlink(missing_ok=True)


def extract_stage(run: Run, workers: int) -> None:
    """Actions and sensors from the traces of the best-of-run's lineage: actions.npz, sensors.npz."""
    if run.file("sensors.npz").exists():
        return
    _forget_after(run, "extract")
    flow = replayed(run, workers)
    actions, report = cluster_actions(segments_of(run, flow), run.settings.actions, run.settings.seed)
    files.write_npz(run.file("actions.npz"), files.to_arrays(actions) | files.to_arrays(report))
    selection = select(flow, run.settings.sensors)
    files.write_npz(run.file("sensors.npz"), {"selected": selection.selected} | files.to_arrays(selection.report))


def learn_stage(run: Run, workers: int) -> None:
    """Q-learning on the source set with what was extracted: qlearning.csv, qnets.npz."""
    if run.file("qnets.npz").exists():
        return
    _forget_after(run, "learn")
    domains = task_of(run).source_domains(run.settings.source)
    networks = _learned(run, domains, "learning", run.settings.episodes, "learn", "qlearning.csv")
    files.write_npz(run.file("qnets.npz"), files.to_arrays(networks))
    run.file("learn.checkpoint.npz").unlink(missing_ok=True)


def transfer_stage(run: Run, workers: int) -> None:
    """The target set: generalisation.csv without learning, then transfer.csv with Q-learning, ER, ER + transfer."""
    if run.file("transfer.csv").exists():
        return
    domains = task_of(run).target_domains(run.settings.source)
    networks = read_networks(run)
    if not run.file("generalisation.csv").exists():
        files.write_csv(run.file("generalisation.csv"), _generalisation(run, domains, networks))
    parts = {"QL": "target_learn.csv", "ER": "target_er.csv", "ER+transfer": "target_er_transfer.csv"}
    if not run.file(parts["QL"]).exists():
        _learned(
            run,
            domains,
            "target_learning",
            run.settings.target_episodes,
            "target_learn",
            parts["QL"],
            networks,
        )
    for method, purpose in (("ER", "target_er"), ("ER+transfer", "target_er_transfer")):
        if not run.file(parts[method]).exists():
            front = None if method == "ER" else read_individuals(run, "pareto.npz").genomes
            problem = _problem(run, domains, purpose, workers)
            _evolved(run, problem, run.settings.target_generations, purpose, parts[method], front)
    rows: dict[str, list] = {"method": [], "episodes": [], "score": []}
    for method, name in parts.items():
        columns = files.read_csv(run.file(name))
        episodes, scores = ("episode", "score") if method == "QL" else ("episodes", "best")
        rows["method"] += [method] * len(columns[episodes])
        rows["episodes"] += columns[episodes]
        rows["score"] += columns[scores]
    files.write_csv(run.file("transfer.csv"), rows)
    for name in ("target_learn", "target_er", "target_er_transfer"):
        run.file(f"{name}.checkpoint.npz").unlink(missing_ok=True)


STAGES: dict[str, Callable[[Run, int], None]] = {
    "evolve": evolve_stage,
    "extract": extract_stage,
    "learn": learn_stage,
    "transfer": transfer_stage,
}


def replayed(run: Run, workers: int) -> list[Trace]:
    """The learning traces: the best-of-run's lineage played again.

    Raises:
        RunError: if it does not reach the scores that it was saved with.
    """
    ancestors = read_lineage(run)
    with Progress(f"extract {run.label}", "network", len(ancestors.ids)) as progress:
        flow, scores = traces(source_problem(run, workers), ancestors, progress.update)
    if not np.array_equal(scores, ancestors.scores):
        raise RunError(
            f"{run.file('lineage.npz')} does not replay to the scores it was saved with: it was made by another "
            "version of qboot or on other hardware; evolve again on this one"
        )
    return flow


def segments_of(run: Run, flow: list[Trace]) -> Segments:
    """All linear segments of the traces' commands."""
    return segment((trace.commands for trace in flow), run.settings.actions)


def read_individuals(run: Run, name: str) -> Individuals:
    """Individuals saved by a stage."""
    return files.from_arrays(files.read_npz(run.file(name)), INDIVIDUALS, run.file(name))


def read_lineage(run: Run) -> Individuals:
    """The lineage of the best-of-run, oldest first."""
    return read_individuals(run, "lineage.npz")


def read_actions(run: Run) -> ActionSet:
    """The extracted actions."""
    template = ActionSet(*range(len(ActionSet._fields)))
    return files.from_arrays(files.read_npz(run.file("actions.npz")), template, run.file("actions.npz"))


def read_selection(run: Run) -> np.ndarray:
    """The selected sensors, (lags, S) bool."""
    return files.read_npz(run.file("sensors.npz"))["selected"]


def read_inputs(run: Run) -> InputSet:
    """The selected sensors as inputs of the Q-networks."""
    return input_set(read_selection(run))


def read_networks(run: Run) -> QNetworks:
    """The Q-networks learned on the source set."""
    template = QNetworks(*range(len(QNetworks._fields)))
    return files.from_arrays(files.read_npz(run.file("qnets.npz")), template, run.file("qnets.npz"))


def _forget_after(run: Run, stage: str) -> None:
    """Remove what later stages made of an earlier result, before a stage makes it anew."""
    names = list(FILES)
    for later in names[names.index(stage) + 1 :]:
        for name in FILES[later]:
            run.file(name).unlink(missing_ok=True)


def _problem(run: Run, domains: Domain, purpose: str, workers: int) -> Problem:
    settings = run.settings
    return Problem(task_of(run), domains, settings.evolution, settings.dnn, key_of(run, purpose), workers)


def _algorithm(problem: Problem) -> Algorithm:
    return ALGORITHMS[problem.settings.algorithm]


def _generalisation(run: Run, domains: Domain, networks: QNetworks) -> dict[str, list]:
    """Scores on the target set without learning there: the best-of-run's and the greedy Q-policy's."""
    task, key = task_of(run), key_of(run, "tests")
    best = read_lineage(run).take(slice(-1, None))
    # Recorded as a replay is, though only the scores are read: where shapes agree, one compiled program serves both.
    evaluated = evaluation.evaluate(task, run.settings.dnn, STATES, domains, best.genomes, key[None])
    tests = np.asarray(evaluated.scores)[0]
    evolved = tests.reshape(-1, task.rollouts_per_domain).sum(axis=1)
    learned = policy.evaluate(networks, key, task, domains, read_actions(run), read_inputs(run), run.settings.learner)
    return {
        "method": ["ER"] * len(evolved) + ["QL"] * len(evolved),
        "domain": [*range(len(evolved)), *range(len(evolved))],
        "score": [*map(float, evolved), *map(float, learned)],
    }


def _evolved(
    run: Run, problem: Problem, generations: int, name: str, history_name: str, front: Genome | None = None
) -> State:
    """The end of a run of `generations`, checkpointed under `name`; its history is written when it is over."""
    checkpoint = run.file(f"{name}.checkpoint.npz")
    if checkpoint.exists():
        state, history = _load_evolution(problem, checkpoint)
    else:
        state, info = _algorithm(problem).init(problem, front)
        history = {field: [value] for field, value in info._asdict().items()}
    saved = time.monotonic()
    top = problem.task.max_score_per_domain * len(jax.tree.leaves(problem.domains)[0])
    with Progress(f"{name} {run.label}", "generation", generations, state.generation) as progress:
        while state.generation < generations:
            state, info = _algorithm(problem).step(problem, state)
            for field, value in info._asdict().items():
                history[field].append(value)
            progress.update(state.generation, best=info.best, median=info.median, of=top)
            if time.monotonic() > saved + learning.SECONDS_BETWEEN_SAVES or state.generation == generations:
                _save_evolution(problem, state, history, checkpoint)
                saved = time.monotonic()
    files.write_csv(run.file(history_name), history)
    return state


def _save_evolution(problem: Problem, state: State, history: dict[str, list], checkpoint: Path) -> None:
    arrays = files.to_arrays(_algorithm(problem).condensed(state))
    files.write_npz(checkpoint, arrays | {f"history.{name}": np.array(values) for name, values in history.items()})


def _load_evolution(problem: Problem, checkpoint: Path) -> tuple[State, dict[str, list]]:
    arrays = files.read_npz(checkpoint)
    saved = files.from_arrays(arrays, files.template(_algorithm(problem).saved), checkpoint)
    history = {name: arrays[f"history.{name}"].tolist() for name in EvolveInfo._fields}
    return _algorithm(problem).restored(problem, saved), history


def _learned(
    run: Run,
    domains: Domain,
    purpose: str,
    n_episodes: int,
    name: str,
    history_name: str,
    networks: QNetworks | None = None,
) -> QNetworks:
    """Q-learning for `n_episodes`, checkpointed under `name`, its history written when it is over."""
    task, settings = task_of(run), run.settings.learner
    actions, inputs = read_actions(run), read_inputs(run)
    state = learner.init(key_of(run, purpose), task, domains, actions, inputs, settings, networks=networks)
    checkpoint = run.file(f"{name}.checkpoint.npz")
    progressing = learning.begin(state, checkpoint)
    done = int(progressing.state.episode)
    saved = time.monotonic()
    with Progress(f"{name} {run.label}", "episode", n_episodes, done) as progress:
        for size in learning.call_sizes(done, n_episodes):
            state, info = learner.learn(progressing.state, task, domains, actions, inputs, settings, size)
            progressing = learning.after(progressing, state, info)
            scores = progressing.history["score"]
            progress.update(len(scores), best=max(scores), recent=float(np.mean(scores[-size:])))
            if time.monotonic() > saved + learning.SECONDS_BETWEEN_SAVES:
                learning.save(progressing, checkpoint)
                saved = time.monotonic()
    files.write_csv(run.file(history_name), progressing.history)
    return progressing.state.networks
