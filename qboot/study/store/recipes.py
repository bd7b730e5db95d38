"""The recipes of all files of a run and of a cell: what makes them, from which files, with which settings."""

from typing import NamedTuple


class Recipe(NamedTuple):
    """What one step makes, and all that its files depend on."""

    step: str
    settings: tuple[str, ...]  # besides the task
    needs: tuple[str, ...]  # files of earlier steps
    makes: tuple[str, ...]


_PLACE = ("source", "physics", "seed", "n_steps")

EVOLVE = Recipe(
    "evolve",
    settings=(*_PLACE, "dnn", "evolution"),
    needs=(),
    makes=("history.csv", "lineage.npz", "pareto.npz"),
)
EXTRACT = Recipe(
    "extract",
    settings=(*_PLACE, "dnn", "evolution", "actions", "sensors"),
    needs=("lineage.npz",),
    makes=("actions.npz", "sensors.npz"),
)
LEARN = Recipe(
    "learn",
    settings=(*_PLACE, "learner", "episodes"),
    needs=("actions.npz", "sensors.npz"),
    makes=("qlearning.csv", "qnets.npz"),
)
TRANSFER = Recipe(
    "transfer",
    settings=(*_PLACE, "dnn", "evolution", "learner", "target_episodes", "target_generations"),
    needs=("lineage.npz", "pareto.npz", "actions.npz", "sensors.npz", "qnets.npz"),
    makes=("generalisation.csv", "target_learn.csv", "target_er.csv", "target_er_transfer.csv", "transfer.csv"),
)
OF_RUNS = (EVOLVE, EXTRACT, LEARN, TRANSFER)

# A cell of a control experiment is equipped with files of an evolved run, whose digests its own record repeats.
EVOLVED = ("evolved/lineage.npz", "evolved/actions.npz", "evolved/sensors.npz")
EQUIP = Recipe(
    "equip",
    settings=(*_PLACE, "what", "condition", "actions"),
    needs=EVOLVED,
    makes=("actions.npz", "sensors.npz"),
)
LEARN_CELL = Recipe(
    "ablate",
    settings=(*_PLACE, "what", "condition", "learner", "episodes", "lanes"),
    needs=("actions.npz", "sensors.npz"),
    makes=("qlearning.csv",),
)
OF_CELLS = (EQUIP, LEARN_CELL)
