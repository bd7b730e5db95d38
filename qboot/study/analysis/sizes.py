"""How large a study is, beside the paper's: runs, generations, steps, episodes."""

from typing import NamedTuple

from qboot.study.pipeline import profiles
from qboot.study.store.runs import Run

LABELS = {
    "runs": "runs",
    "population": "individuals of the population",
    "generations": "generations on the source set",
    "n_steps": "steps of a test",
    "horizon": "ancestors in the lineage at most",
    "episodes": "Q-learning episodes on the source set",
    "target_episodes": "Q-learning episodes on the target set",
    "target_generations": "generations of ER on the target set",
}
# The paper prints no budgets on the target set; those of the profile "paper" reach its medians.
NOT_PRINTED = ("target_episodes", "target_generations")


class Size(NamedTuple):
    """One size of a study beside the paper's."""

    label: str
    ours: tuple[int, ...]  # the different values that the runs have, smallest first
    paper: int
    is_printed: bool  # whether the paper prints it

    @property
    def is_reduced(self) -> bool:
        """Whether some run is smaller than the paper's."""
        return self.ours[0] < self.paper


def of_run(run: Run) -> dict[str, int]:
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


def of_paper(task: str) -> dict[str, int]:
    """The paper's sizes, which are those of the profile "paper"."""
    size = profiles.size_of(task, "paper")
    return {"runs": size.runs_per_source * len(size.sources)} | {
        name: getattr(size, name) for name in LABELS if name != "runs"
    }


def beside_paper(some: list[Run]) -> list[Size]:
    """All sizes of the runs (at least one) of one task."""
    paper = of_paper(some[0].settings.task)
    of_runs = [of_run(run) for run in some]
    values = {"runs": {len(some)}} | {name: {sizes[name] for sizes in of_runs} for name in of_runs[0]}
    return [
        Size(label, tuple(sorted(values[name])), paper[name], name not in NOT_PRINTED) for name, label in LABELS.items()
    ]
