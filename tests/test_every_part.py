"""Every row of every table goes from sensors to a report: the toy robot in seconds, the paper's tasks in minutes."""

import json
import re
import shutil
import warnings
from dataclasses import replace

import pytest
from conftest import promotion_for, tiny_settings
from toy_tasks import RANDOM, corridor

from qboot import envs
from qboot.envs import registry
from qboot.extraction.clustering import CLUSTERINGS
from qboot.extraction.segmentation import SEGMENTATIONS
from qboot.extraction.sensors import SELECTIONS
from qboot.neuroevolution.algorithms import ALGORITHMS
from qboot.qlearning import LEARNERS
from qboot.study.pipeline import profiles
from qboot.study.pipeline.table import STAGES
from qboot.study.report import page
from qboot.study.store import provenance, runs
from qboot.study.store.provenance import RECORD

TABLES = {
    ("evolution", "algorithm"): ALGORITHMS,
    ("actions", "segmentation"): SEGMENTATIONS,
    ("actions", "clustering"): CLUSTERINGS,
    ("sensors", "selection"): SELECTIONS,
    ("learner", "algorithm"): LEARNERS,
}
# Files that a part has no say in, by the room of its setting.
EVOLVED = ("history.csv", "lineage.npz", "pareto.npz")
SHARED = {"actions": EVOLVED, "sensors": EVOLVED, "learner": (*EVOLVED, "actions.npz", "sensors.npz")}
# Starts are drawn at random, so that some rollouts are long whatever evolved.
TASK = corridor((5, RANDOM), (0, RANDOM), max_steps=40, rollouts_per_domain=4)
ROWS = [
    (room, field, name)
    for (room, field), table in TABLES.items()
    # The first row is today's default, which all other tests are made of.
    for name in list(table)[1:]
]
pytestmark = pytest.mark.filterwarnings("ignore:only .* of the .* extracted actions are distinct")


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A finished run of the toy robot with all the defaults; it is registered as long as this module runs."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # actions coincide
        patch.setattr(registry, "_registered", {})
        envs.register(TASK)
        settings = profiles.settings_of("corridor", "smoke", "A", 0)
        evolution = replace(settings.evolution, population=8, generations=2)
        settings = replace(
            settings,
            evolution=evolution,
            actions=replace(settings.actions, n_actions=3),
            sensors=replace(settings.sensors, lags=2),
            target_generations=1,
        )
        run = runs.create(tmp_path_factory.mktemp("base") / "corridor" / "A-0", settings)
        for stage in STAGES:
            stage.do(run)
        yield run


def go_through(run, settings, room, field, name, folder):
    """A run with one other part, from the files that it has no say in to a report; what its configuration says."""
    changed = replace(settings, **{room: replace(getattr(settings, room), **{field: name})})
    new = runs.create(folder / run.folder.parent.name / run.folder.name, changed)
    for file in SHARED.get(room, ()):
        shutil.copy(run.file(file), new.file(file))
        shutil.copy(run.file(RECORD), new.file(RECORD))
        assert provenance.is_whole(new, file)
    with promotion_for(name):
        for stage in STAGES:
            stage.do(runs.load(new.folder))
            assert stage.is_done(new)
    text = page.write(folder).read_text()
    assert not re.search(r"<tbody>\s*</tbody>", text)
    return json.loads(new.file("config.json").read_text())["settings"][room][field]


@pytest.mark.parametrize(
    ("room", "field", "name"),
    # One of each table in seconds, the others in minutes.
    [
        pytest.param(*row, marks=() if row[2] == list(TABLES[row[:2]])[1] else pytest.mark.slow, id="-".join(row))
        for row in ROWS
    ],
)
def test_a_toy_robot_goes_through_with_every_part(base, tmp_path, room, field, name):
    assert go_through(base, base.settings, room, field, name, tmp_path) == name


@pytest.mark.slow
@pytest.mark.parametrize("task", registry.BUILT_IN)
@pytest.mark.parametrize(("room", "field", "name"), ROWS)
def test_the_tasks_of_the_paper_go_through_with_every_part(built_in, tmp_path, task, room, field, name):
    run = built_in(task)
    assert go_through(run, run.settings, room, field, name, tmp_path) == name


@pytest.fixture(scope="module")
def built_in(tmp_path_factory):
    """(task) -> a finished tiny run of it."""
    finished = {}

    def run_of(task):
        if task not in finished:
            settings = tiny_settings(task)
            physics = envs.get_task(task).physics[-1]  # the fastest to compile
            settings = replace(settings, physics=physics, n_steps=120)
            finished[task] = runs.create(tmp_path_factory.mktemp("base") / task / "A-0", settings)
            for stage in STAGES:
                stage.do(finished[task])
        return finished[task]

    return run_of
