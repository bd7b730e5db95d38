"""The control experiments in figures, tests and report: the paper's tables, and verdicts by their rules."""

import itertools
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import record_all

from qboot.envs import get_task, registry
from qboot.study.analysis import appendix, control_measures, rules
from qboot.study.analysis.rules import AGREES, CANNOT_TELL, DIFFERS, NO_DATA, NO_NUMBER, NO_PAPER, OWN_DIFFER
from qboot.study.controls import cells
from qboot.study.controls.conditions import WHATS, conditions
from qboot.study.figures import catalogue, controls
from qboot.study.pipeline import profiles
from qboot.study.report import page as report
from qboot.study.store import files, runs

SEEDS = range(5)


@pytest.fixture(scope="module")
def paper_sized(tiny_study, tmp_path_factory):
    """Five learners per set of actions, of the paper's size as far as their files tell, and the run behind them.

    Extracted actions score 6 or 7, random ones 0 to 2, human-designed ones 5 to 9: only random ones stand out.
    """
    folder = tmp_path_factory.mktemp("paper")
    settings = profiles.settings_of("ball_collecting", "paper", "A", 0)
    run = runs.create(folder / "ball_collecting" / "A-0", settings)
    scores = {"extracted": [6, 6, 7, 7, 7], "human": [5, 6, 7, 8, 9], "random": [0, 1, 1, 2, 2]}
    some = cells.find(tiny_study, "ball_collecting", "actions")
    for condition, seed in itertools.product(scores, SEEDS):
        cell = some[condition][seed % 2]
        changed = replace(cell.settings, seed=seed, n_steps=10_000, episodes=10_000)
        made = runs.create(folder / "ablations" / "ball_collecting" / "actions" / condition / str(seed), changed)
        for name in ("actions.npz", "sensors.npz"):
            shutil.copy(cell.file(name), made.folder)
        score = scores[condition][seed]
        # Nothing is learned before half of the time.
        by_episode = np.where(np.arange(1, 10_001) > 5_000, float(score), 0.0)
        columns = {"episode": np.arange(1, 10_001), "score": by_episode, "steps": np.full(10_000, 20_000)}
        files.write_csv(made.file("qlearning.csv"), columns)
        record_all(made)
    return folder, [run]


def tables_of(study, some):
    return appendix.tables({what: cells.find(study, "ball_collecting", what) for what in WHATS}, some)


def test_the_tables_have_the_papers_pairs():
    """Sections A-A and A-B: 3 pairs of actions, 10 of sensors."""
    for name in registry.BUILT_IN:
        task = get_task(name)
        paper = task.paper()
        assert [len(table.printed) for table in paper.test_tables] == [3, 10, 10]
        for table in paper.test_tables:
            names = set(conditions(task, table.what))
            assert {frozenset(pair) for pair in table.printed} == {
                frozenset(pair) for pair in itertools.combinations(names, 2)
            }
            assert table.measure in control_measures.CONTROL_MEASURES
        for claim in paper.control_conclusions:
            assert {claim.conclusion.first, claim.conclusion.second} <= set(conditions(task, claim.what))
            assert claim.measure in control_measures.CONTROL_MEASURES


def test_pairs_are_tested_at_three_times(paper_sized):
    early, late, end = tables_of(*paper_sized)[:3]
    assert (early.episodes, late.episodes, end.episodes) == (3_333, 6_666, 10_000)
    assert early.names == ["random", "human", "extracted"]
    assert {pair.comparison.p_value for pair in early.pairs.values()} == {1.0}
    for table in (late, end):
        pair = table.pairs["random", "human"]
        assert pair.n_cells == (5, 5) and pair.medians == (1, 7)
        # All of five are below all of five: exact 2 / 252 without ties, near it with them.
        assert pair.comparison.a12 == 0 and pair.comparison.p_value < 0.02
        assert pair.interval == (0, 0)
        assert pair.verdict.answer == AGREES


def test_equal_by_few_learners_is_not_compared(paper_sized):
    end = tables_of(*paper_sized)[2]
    pair = end.pairs["human", "extracted"]
    assert pair.comparison.p_value > 0.05 and pair.printed == (0.2018, 0.0081, 0.0004)
    assert pair.verdict == OWN_DIFFER
    assert tables_of(*paper_sized)[3].pairs["instant", "human"].verdict == NO_DATA


def test_conclusions_are_tested_on_cells(paper_sized):
    folder, some = paper_sized
    found = {what: cells.find(folder, "ball_collecting", what) for what in WHATS}
    extracted, human, instant, selected, alike, *others = appendix.findings(found, some)
    assert extracted.medians == (7, 1) and extracted.verdict.answer == AGREES
    assert human.medians == (7, 1) and human.n_runs == 5 and human.verdict.answer == AGREES
    # Medians are equal, but five learners do not exclude a difference of more than one ball.
    assert alike.medians == (7, 7) and alike.interval[0] < -1 and alike.verdict.answer == CANNOT_TELL
    assert {finding.verdict for finding in (instant, selected, *others)} == {NO_DATA}


def test_only_the_runs_behind_the_learners_have_to_be_long_enough(paper_sized, tiny_run):
    folder, [run] = paper_sized
    found = cells.find(folder, "ball_collecting", "actions")
    other = runs.Run(folder / "ball_collecting" / "B-0", tiny_run.settings)
    assert appendix.shortfall(found, "actions", [run, other]) == ""
    moved = replace(found["human"][0].settings, evolved="B-0")
    with_other = found | {"human": [runs.Run(found["human"][0].folder, moved)]}
    assert "individuals of the population: 8 of 128" in appendix.shortfall(with_other, "actions", [run, other])
    for falls_short in (appendix.shortfall, appendix.shortfall_of_order):
        assert falls_short(with_other, "actions", [run]) == "evolved runs that are gone: B-0"


def test_an_order_can_show_before_the_papers_episodes(paper_sized, tmp_path):
    """That two conditions do not differ cannot: before anything is learned, nothing does."""
    folder, some = paper_sized
    shutil.copytree(folder, tmp_path / "study")
    shorter = {
        condition: [runs.Run(cell.folder, replace(cell.settings, episodes=6_000)) for cell in of_condition]
        for condition, of_condition in cells.find(tmp_path / "study", "ball_collecting", "actions").items()
    }
    for cell in itertools.chain(*shorter.values()):
        record_all(cell)
    extracted, human, _, _, alike, *_ = appendix.findings({what: {} for what in WHATS} | {"actions": shorter}, some)
    assert extracted.verdict.answer == human.verdict.answer == AGREES
    assert alike.verdict == rules.Verdict(CANNOT_TELL, "episodes of a learner: 6,000 of 10,000")


@pytest.mark.parametrize(
    ("p_value", "printed", "n_cells", "comparable", "expected"),
    [
        (0.01, (0.001,), 5, True, AGREES),
        (0.01, (0.3,), 5, True, DIFFERS),
        (0.01, (0.001,), 4, True, CANNOT_TELL),
        (0.01, (0.001,), 30, False, CANNOT_TELL),
        (0.5, (0.001,), 30, True, DIFFERS),
        (0.5, (0.3,), 30, True, AGREES),
        (0.5, (0.3,), 29, True, CANNOT_TELL),
        (0.5, (), 30, True, NO_NUMBER.answer),
        (0.5, None, 30, True, NO_PAPER.answer),
        (np.nan, (0.3,), 0, True, NO_DATA.answer),
        (0.5, (0.3, 0.01), 30, True, OWN_DIFFER.answer),
    ],
)
def test_the_rule_for_pairs(p_value, printed, n_cells, comparable, expected):
    assert rules.judge_pair(p_value, printed, n_cells, "" if comparable else "too short").answer == expected


def test_small_cells_are_not_compared(tiny_study, tiny_run):
    verdicts = {pair.verdict for table in tables_of(tiny_study, [tiny_run]) for pair in table.pairs.values()}
    assert {verdict.answer for verdict in verdicts} == {CANNOT_TELL} and {NO_NUMBER, OWN_DIFFER} < verdicts
    assert any("individuals of the population: 8 of 128" in verdict.why for verdict in verdicts)


def test_measures_of_a_cell(paper_sized):
    folder, _ = paper_sized
    cell = cells.find(folder, "ball_collecting", "actions")["human"][4]
    assert control_measures.performance(cell, 10_000) == 9
    assert control_measures.performance(cell, 5_000) == 0
    assert control_measures.performance(cell, 5_010) == 9 * 10 / 20
    assert control_measures.average_performance(cell, 10_000) == 4.5
    assert control_measures.average_performance(cell, 5_000) == 0
    assert control_measures.steps(cell, 3_333) == 20_000


def test_the_report_holds_the_control_experiments(tiny_study, tmp_path):
    shutil.copytree(tiny_study, tmp_path / "study")
    page = report.write(tmp_path / "study").read_text()
    for name in catalogue.CONTROL_PLOTS:
        assert f'id="ball_collecting-figure-{name}"' in page
    assert re.findall(r"<h3[^>]*>Figure (\d+)", page)[-3:] == ["17", "18", "19"]
    assert page.count("data:image/png;base64,") == len(catalogue.names_of(get_task("ball_collecting"))) + 3
    assert page.count("<caption>") == 5
    assert "8.34e-29" in page and "0.0081" in page
    assert "missing</dt>" not in page
    names = re.findall(r'id="([^"]+)"', page)
    assert len(names) == len(set(names))


def test_figures_of_cells_are_commands(tiny_study, tmp_path, capsys):
    for number in (17, 18, 19):
        path = tmp_path / f"{number}.png"
        assert catalogue.command(number, [str(tiny_study), "--out", str(path)]) == 0
        assert path.read_bytes().startswith(b"\x89PNG")
    none = ["--out", str(tmp_path / "none.png")]
    assert catalogue.command(17, [str(tmp_path), *none]) == 2
    assert "qboot ablate --task ball_collecting --what actions" in capsys.readouterr().err
    assert catalogue.command(17, [str(tiny_study), "--task", "box_pushing", *none]) == 2
    assert "qboot ablate --task box_pushing --what actions" in capsys.readouterr().err
    assert catalogue.command(17, [str(tiny_study), "--task", "flying", *none]) == 2
    assert "unknown task 'flying'" in capsys.readouterr().err


def test_steps_are_drawn_where_episodes_differ_in_length(paper_sized):
    folder, _ = paper_sized
    some = cells.find(folder, "ball_collecting", "actions")
    assert len(controls.learning_by_actions(some).figure.axes) == 1  # all of 20,000 steps
    cell = some["random"][0]
    kept = cell.file("qlearning.csv").read_text()
    cell.file("qlearning.csv").write_text(kept.replace("20000", "19000", 1))
    record_all(cell)
    try:
        assert len(controls.learning_by_actions(some).figure.axes) == 2
    finally:
        cell.file("qlearning.csv").write_text(kept)
        record_all(cell)


def test_curves_end_where_all_conditions_have_been(paper_sized, tmp_path):
    """As the tables do: a cell that serves another experiment too may have had more episodes than the others."""
    shutil.copytree(paper_sized[0], tmp_path / "study")
    found = cells.find(tmp_path / "study", "ball_collecting", "actions")
    shorter = [runs.Run(cell.folder, replace(cell.settings, episodes=5_000)) for cell in found["random"]]
    for cell in shorter:
        columns = files.read_csv(cell.file("qlearning.csv"))
        files.write_csv(cell.file("qlearning.csv"), {name: values[:5_000] for name, values in columns.items()})
        record_all(cell)
    drawn = controls.learning_by_actions(found | {"random": shorter})
    assert drawn.shows.startswith("Median at the end: extracted 0; human 0; random 0.")  # nobody has learned by then
    assert {line.get_xdata()[-1] for line in drawn.figure.axes[0].lines[:3]} == {5_000}


def test_without_a_paper_conditions_are_compared_all_the_same(tiny_study, tiny_run, monkeypatch):
    monkeypatch.setattr(appendix, "task_of", lambda run: get_task("ball_collecting")._replace(paper=None))
    found = tables_of(tiny_study, [tiny_run])
    assert [(table.table.what, len(table.pairs)) for table in found] == [
        ("actions", 3),
        ("sensors", 10),
        ("n_actions", 10),
    ]
    assert {pair.verdict for table in found for pair in table.pairs.values()} == {NO_PAPER}
    assert appendix.findings({what: {} for what in WHATS}, [tiny_run]) == []
