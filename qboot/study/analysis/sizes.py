"""How large a study is, beside the paper's where one tells of the task: runs, generations, steps, episodes."""

from typing import NamedTuple

from qboot.envs.task import Task
from qboot.study.pipeline import profiles
from qboot.study.store.artifacts import task_of
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

LABELS = {
    "runs": "runs",
    "population": "individuals of the population",
    "generations": "generations on the source set",
    "n_steps": "timesteps of a rollout at most",
    "horizon": "ancestors in the lineage at most",
    "episodes": "Q-learning episodes on the source set",
    "target_episodes": "Q-learning episodes on the target set",
    "target_generations": "generations of ER on the target set",
}


class SizeRow(NamedTuple):
    """One size of a study beside the paper's."""

    label: str
    ours: tuple[int, ...]  # the different values that the runs have, smallest first
    paper: int | None  # None without a paper
    is_printed: bool  # whether the paper prints it

    @property
    def is_reduced(self) -> bool:
        """Whether some run is smaller than the paper's."""
        return self.paper is not None and self.ours[0] < self.paper


def of_run(run: Run[RunSettings]) -> dict[str, int]:
    """The sizes of one run."""
    settings = run.settings
    evolution = settings.evolution
    return {
        "population": evolution.population,
        "generations": evolution.generations,
        "n_steps": settings.n_steps,
        "horizon": evolution.horizon,
        "episodes": settings.episodes,
        "target_episodes": settings.target_episodes,
        "target_generations": settings.target_generations,
    }


def of_paper(task: Task) -> dict[str, int]:
    """The paper's sizes, which are those of the profile "paper"; nothing for a task that no paper tells of."""
    if task.paper is None:
        return {}
    size = profiles.size_of(task, "paper")
    return {"runs": size.runs_per_source * len(size.sources)} | {
        name: getattr(size, name) for name in LABELS if name != "runs"
    }


def rows(some: list[Run[RunSettings]]) -> list[SizeRow]:
    """All sizes of the runs (at least one) of one task, the paper's beside them."""
    task = task_of(some[0])
    paper = of_paper(task)
    printed = set(paper) - set(task.paper().not_printed if task.paper else ())
    of_runs = [of_run(run) for run in some]
    values = {"runs": {len(some)}} | {name: {sizes[name] for sizes in of_runs} for name in of_runs[0]}
    return [
        SizeRow(label, tuple(sorted(values[name])), paper.get(name), name in printed) for name, label in LABELS.items()
    ]
