"""The stage transfer: the target set, without learning there and with it (sections V-B3 and VI-B3)."""

from typing import Any

from qboot import qlearning
from qboot.envs.task import Domain
from qboot.neuroevolution import evaluation
from qboot.neuroevolution.recorders import STATES
from qboot.study.pipeline.evolving import evolved, problem_on
from qboot.study.pipeline.learning import learned
from qboot.study.pipeline.learning import problem_on as learning_problem_on
from qboot.study.store.artifacts import (
    key_of,
    read_columns,
    read_individuals,
    read_lineage,
    read_networks,
    task_of,
)
from qboot.study.store.output import Output
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# A method, the name of its checkpoint, stream and table, and the columns that count.
PARTS = {
    "QL": ("target_learn", "episode", "score"),
    "ER": ("target_er", "episodes", "best"),
    "ER+transfer": ("target_er_transfer", "episodes", "best"),
}


def transfer_stage(run: Run[RunSettings], output: Output, workers: int) -> None:
    """The target set: generalisation.csv without learning, then transfer.csv with Q-learning, ER, ER + transfer."""
    domains = task_of(run).target_domains(run.settings.source)
    networks = read_networks(run, learning_problem_on(run, domains))
    if not output.has("generalisation.csv"):
        output.write_csv("generalisation.csv", _generalisation(run, domains, networks))
    if not output.has("target_learn.csv"):
        episodes = run.settings.target_episodes
        # Exploration goes on from where it was: the paper's "first episodes show generalization capacities" (figure 9),
        # which they would not with one random action in seven again.
        learned(
            run,
            output,
            domains,
            "target_learning",
            episodes,
            "target_learn",
            "target_learn.csv",
            networks,
            episode=run.settings.episodes,
        )
    for method, (name, *_) in PARTS.items():
        if method != "QL" and not output.has(f"{name}.csv"):
            front = read_individuals(run, "pareto.npz").genomes if method == "ER+transfer" else None
            problem = problem_on(run, domains, name, workers)
            evolved(output, problem, run.settings.target_generations, name, f"{name}.csv", front, until_top=True)
    rows: dict[str, list] = {"method": [], "episodes": [], "score": []}
    for method, (name, episodes_column, score_column) in PARTS.items():
        columns = read_columns(run, f"{name}.csv")
        rows["method"] += [method] * len(columns[episodes_column])
        rows["episodes"] += columns[episodes_column]
        rows["score"] += columns[score_column]
    output.write_csv("transfer.csv", rows)


def _generalisation(run: Run[RunSettings], domains: Domain, networks: Any) -> dict[str, list]:
    """Scores on the target set without learning there: the best-of-run's and the greedy Q-policy's."""
    task, key = task_of(run), key_of(run, "rollouts")
    best = read_lineage(run).take(slice(-1, None))
    # Recorded as a replay is, though only the scores are read: where shapes agree, one compiled program serves both.
    evaluated = evaluation.evaluate_all(task, run.settings.dnn, STATES, domains, best.genomes, key[None], workers=1)
    scores = evaluated.scores[0]
    of_network = scores.reshape(-1, task.rollouts_per_domain).sum(axis=1)
    of_policy = qlearning.evaluate(networks, key, learning_problem_on(run, domains))
    return {
        "method": ["ER"] * len(of_network) + ["QL"] * len(of_network),
        "domain": [*range(len(of_network)), *range(len(of_network))],
        "score": [*map(float, of_network), *map(float, of_policy)],
    }
