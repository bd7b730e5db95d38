"""What the files of a run hold, as the values that the method works with."""

from typing import Any

import jax
import numpy as np

from qboot.envs.registry import get_task
from qboot.envs.task import Task
from qboot.extraction.actions import ActionSet
from qboot.keys import key
from qboot.neuroevolution.lineage import Individuals
from qboot.qlearning.inputs import InputSet, input_set
from qboot.qlearning.problem import Problem, networks_template
from qboot.study.store import files, provenance
from qboot.study.store.runs import AnyRun, Run
from qboot.study.store.settings import RunSettings


def task_of(run: AnyRun) -> Task:
    """The run's task, with its rollouts as long as the settings say."""
    return get_task(run.settings.task, run.settings.physics)._replace(max_steps=run.settings.n_steps)


def key_of(run: AnyRun, purpose: str) -> jax.Array:
    """The random key of one purpose within the run."""
    return key(jax.random.key(run.settings.seed), purpose)


def read_arrays(run: AnyRun, name: str) -> dict[str, np.ndarray]:
    """Named arrays of a file of the run; raises RunError unless it is whole and made with the settings of now."""
    provenance.require(run, name)
    return files.read_npz(run.file(name))


def read_columns(run: AnyRun, name: str) -> dict[str, list[str]]:
    """Named columns, as text, of a file of the run; errors as `read_arrays`."""
    provenance.require(run, name)
    return files.read_csv(run.file(name))


def read_individuals(run: Run[RunSettings], name: str) -> Individuals:
    """Individuals saved by a stage; they had all the room for hidden neurons where a file of 0.2.dev0 does not tell."""
    arrays = read_arrays(run, name)
    all_room = np.full(len(arrays.get("ids", ())), run.settings.dnn.max_hidden, np.int32)
    return files.from_arrays({"rooms": all_room} | arrays, Individuals, run.file(name))


def read_lineage(run: Run[RunSettings]) -> Individuals:
    """The lineage of the best-of-run, oldest first."""
    return read_individuals(run, "lineage.npz")


def lineage_length(run: AnyRun) -> int:
    """Individuals in the lineage of the best-of-run."""
    return len(files.pick(read_arrays(run, "lineage.npz"), "ids", run.file("lineage.npz")))


def read_actions(run: AnyRun) -> ActionSet:
    """The extracted actions."""
    return files.from_arrays(read_arrays(run, "actions.npz"), ActionSet, run.file("actions.npz"))


def read_selection(run: AnyRun) -> np.ndarray:
    """The selected sensors, (lags, S) bool."""
    return files.pick(read_arrays(run, "sensors.npz"), "selected", run.file("sensors.npz"))


def read_inputs(run: AnyRun) -> InputSet:
    """The selected sensors as inputs of the Q-networks."""
    return input_set(read_selection(run))


def read_networks(run: AnyRun, problem: Problem) -> Any:
    """The networks learned on the source set, of the kind and shapes that the learner of `problem` has."""
    return files.like(read_arrays(run, "qnets.npz"), networks_template(problem), run.file("qnets.npz"))
