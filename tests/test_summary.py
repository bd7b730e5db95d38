"""The few lines on top of a report: what was done, what came out, how far to trust it."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import claims_of, record_all, tiny_settings

from qboot.study.analysis.claims import Claim, counted
from qboot.study.analysis.rules import AGREES, CANNOT_TELL, DIFFERS, Verdict
from qboot.study.analysis.summary import summary
from qboot.study.controls.cells import find
from qboot.study.controls.conditions import WHATS
from qboot.study.pipeline import profiles
from qboot.study.report import page
from qboot.study.store import files, publishing, runs

NO_CELLS = {what: {} for what in WHATS}


def summarised(cells, some):
    return summary(cells, some, claims_of(cells, some))


@pytest.fixture
def scored(tmp_path):
    """Five runs of the paper's size whose files say what they scored: 4 to 8 balls of 8, then 10 to 18 of 24."""
    for seed in range(5):
        run = runs.create(
            tmp_path / "ball_collecting" / f"A-{seed}", profiles.settings_of("ball_collecting", "paper", "A", seed)
        )
        files.write_csv(run.file("history.csv"), {"episodes": [128, 256], "best": [0.0, 4.0 + seed]})
        scores = {"method": ["ER", "QL", "QL"], "score": [3.0, 5.0, 5.0 + 2 * seed]}
        files.write_csv(run.file("generalisation.csv"), scores)
        episodes = np.arange(1, 41)
        files.write_csv(run.file("qlearning.csv"), {"episode": episodes, "score": np.where(episodes > 20, 6.0, 0.0)})
        record_all(run)
    return runs.find(tmp_path)


def test_what_came_out_is_told_by_medians_and_ranges(scored):
    found = summarised(NO_CELLS, scored).found
    assert found[:2] == [
        "Source set, of 8: evolution's best at the end 6 (median of 5, 4 to 8); "
        "Q-learning, mean of the last 20 episodes 6 (median of 5, 6 to 6).",
        "New domains without learning there, of 24: the network 3 (median of 5, 3 to 3); "
        "the Q-policy 14 (median of 5, 10 to 18).",
    ]
    assert "after learning" not in " ".join(found)  # nobody has learned there
    assert found[-1] == "Of the paper's 24 claims 1 agrees, 3 differ and of 20 it cannot be told."


@pytest.mark.parametrize(
    ("n_of_each", "words"),
    [
        ((4, 1, 19), "24 claims 4 agree, 1 differs and of 19 it cannot be told."),
        ((1, 0, 2), "3 claims 1 agrees, 0 differ and of 2 it cannot be told."),
        ((0, 0, 1), "1 claim 0 agree, 0 differ and of 1 it cannot be told."),
    ],
)
def test_claims_are_counted_in_a_sentence(n_of_each, words):
    answers = [answer for answer, n in zip((AGREES, DIFFERS, CANNOT_TELL), n_of_each, strict=True) for _ in range(n)]
    some = [Claim("", "", "", "", 5, Verdict(answer, "")) for answer in answers]
    assert counted(some) == f"Of the paper's {words}"


def test_few_reduced_or_incomplete_runs_are_said(scored):
    few, reduced, incomplete = summarised(NO_CELLS, scored[:2]).trust
    assert few == "2 runs: chance alone can make such differences, at least 5 are compared."
    assert reduced == (  # in the number of runs
        "The sizes of this study are reduced: 1 of 8 is below the paper's, therefore many of the numbers cannot be "
        "compared with the paper's. They show that every step works, and where it leads."
    )
    assert incomplete == "2 of 2 runs are not complete. Missing: evolve, extract, transfer in A-0, A-1."
    small = runs.Run(scored[0].folder, tiny_settings())
    assert summarised(NO_CELLS, [small]).trust[1].startswith("The sizes of this study are reduced: 8 of 8 are below")
    assert not any("chance alone" in sentence for sentence in summarised(NO_CELLS, scored).trust)


def test_a_published_study_is_as_complete_as_it_was(tiny_study, tmp_path):
    publishing.publish(tiny_study, tmp_path / "published")
    told = summarised(NO_CELLS, runs.find(tmp_path / "published"))
    assert not any("not complete" in sentence for sentence in told.trust)


def test_a_complete_study_is_told(tiny_study, tiny_run):
    cells = {what: find(tiny_study, "ball_collecting", what) for what in WHATS}
    told = summarised(cells, runs.find(tiny_study))
    assert told.done == [
        "1 run (source set A; profile tiny): 8 networks evolve for 3 generations, then Q-learning for 3 episodes with "
        "the actions and sensors extracted from them; rollouts of at most 240 timesteps.",
        "3 control experiments (actions, sensors, number of actions), 2 learners per condition.",
    ]
    assert not any("not complete" in sentence for sentence in told.trust)
    assert len(told.found) == 4 and told.found[2].startswith("New domains after learning there, of 24: Q-learning ")


def test_other_physics_than_that_of_record_is_said(tmp_path):
    settings = replace(profiles.settings_of("box_pushing", "paper", "A", 0), physics="kinematic")
    run = runs.create(tmp_path / "box_pushing" / "A-0", settings)
    told = summarised(NO_CELLS, [run])
    assert told.trust[-1] == "Physics kinematic, not that of record (mjx)."
    assert told.found[0].startswith("Of the paper's") and "0 agree, 0 differ" in told.found[0]


def test_the_summary_comes_before_everything_else(tiny_run, tmp_path):
    shutil.copytree(tiny_run.folder, tmp_path / "ball_collecting" / "A-0")
    text = page.write(tmp_path).read_text()
    order = [
        "in short</h2>",
        "<nav",
        "The paper&#39;s conclusions</h3>",
        "<img",
        "<canvas",
        "The paper&#39;s numbers</h3>",
        "Sizes</h3>",
    ]
    places = [text.index(mark) for mark in order]
    assert places == sorted(places)
