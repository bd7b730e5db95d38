"""The report, its figures and its players: complete, self-contained, honest about what is missing."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import record_all, tiny_settings

from qboot.envs import get_task, registry
from qboot.study.analysis import measures, recordings, rules, sizes, verdicts
from qboot.study.analysis.curves import Curve, moving_mean
from qboot.study.analysis.measures import EVOLVED
from qboot.study.analysis.printed import Result
from qboot.study.analysis.rules import AGREES, CANNOT_TELL, DIFFERS, NO_DATA, NO_PAPER
from qboot.study.analysis.statistics import Comparison
from qboot.study.figures import catalogue, drawing
from qboot.study.pipeline import profiles
from qboot.study.pipeline.table import STAGES
from qboot.study.report import page as report
from qboot.study.report import player, tables, templating
from qboot.study.store import files, runs
from qboot.study.store.artifacts import read_lineage, task_of
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run
from qboot.study.store.settings import CellSettings, RunSettings

REACHED = (150, 198, 287, 586, 700)  # generations; their quartiles are the paper's


def copied(run, folder):
    """A copy of a run, as a study of its own that may be changed."""
    shutil.copytree(run.folder, folder / "ball_collecting" / "A-0")
    return runs.load(folder / "ball_collecting" / "A-0")


def players_of(page):
    return [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)]


def bare(task):
    """The task without all that is optional."""
    return task._replace(name="bare", expert=None, view=None, defaults=None, paper=None)


@pytest.fixture
def bare_study(tiny_study, tmp_path, monkeypatch):
    """The tiny study, said to be of a task that has nothing optional."""
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(bare(get_task("ball_collecting")))
    for config in tiny_study.rglob("config.json"):
        copy = tmp_path / str(config.relative_to(tiny_study).parent).replace("ball_collecting", "bare")
        if not {"human", "30", "50"} & set(copy.parts):  # the conditions of a task without an expert
            shutil.copytree(config.parent, copy)
            text = config.read_text().replace('"ball_collecting"', '"bare"')
            (copy / "config.json").write_text(text)
            record_all(runs.load(copy, CellSettings if "ablations" in copy.parts else RunSettings))
    return tmp_path


@pytest.fixture(scope="module")
def page(tiny_run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reported")
    copied(tiny_run, folder)
    return report.write(folder).read_text()


@pytest.fixture
def paper_sized(tmp_path):
    """Five runs of the paper's size that scored, as far as their files tell, what REACHED says."""
    for seed, generation in enumerate(REACHED):
        run = runs.create(
            tmp_path / "ball_collecting" / f"A-{seed}", profiles.settings_of("ball_collecting", "paper", "A", seed)
        )
        steps = np.arange(0, 1001)
        history = {"generation": steps, "episodes": 256 + 128 * steps, "best": np.where(steps < generation, 5.0, 8.0)}
        files.write_csv(run.file("history.csv"), history)
        episodes = np.arange(1, 10_001)
        transfer = [("QL", episodes, np.full(10_000, 20.0 + seed)), ("ER", 256 + 128 * steps, np.full(1001, 7.0))]
        transfer.append(("ER+transfer", 256 + 128 * steps, np.full(1001, 20.0 + seed)))
        files.write_csv(
            run.file("transfer.csv"),
            {
                "method": [method for method, at, _ in transfer for _ in at],
                "episodes": np.concatenate([at for _, at, _ in transfer]),
                "score": np.concatenate([scores for *_, scores in transfer]),
            },
        )
        scores = {"method": ["ER"] * 2 + ["QL"] * 2, "domain": [0, 1] * 2, "score": [1.0, 1.0, 5.0, 5.0 + seed]}
        files.write_csv(run.file("generalisation.csv"), scores)
        record_all(run)
    return runs.find(tmp_path)


def test_the_page_holds_every_figure_and_needs_nothing_else(page):
    names = catalogue.names_of(get_task("ball_collecting"))
    assert page.count("data:image/png;base64,") == len(names) == 7
    for name in names:
        assert f'id="ball_collecting-figure-{name}"' in page
    assert re.findall(r"<h3[^>]*>Figure (\d+)", page) == ["3", "4", "5", "6", "7", "8", "9"]
    assert "missing</dt>" not in page
    assert "Control experiments" not in page  # this study has none
    assert "no cells of the control experiment sensors" in page
    assert not re.search(r'(src|href)="(?!data:|#)', page) and "@import" not in page and "url(" not in page
    assert len(page) < 3_000_000


def test_every_link_of_the_contents_leads_somewhere(page):
    for name in re.findall(r'href="#([^"]+)"', page):
        assert f'id="{name}"' in page


def test_reduced_sizes_are_said_on_top(page):
    assert "The sizes of this study are reduced" in page
    assert CANNOT_TELL in page and AGREES not in re.findall(r'class="verdict (\w+)', page)


def test_the_page_plays_networks_and_policies(page):
    replays = players_of(page)
    assert [len(both) for both in replays] == [2, 2] and page.count("<canvas") == 2
    for data in (data for both in replays for data in both):
        frames = len(data["steps"])
        assert data["steps"][0] == 0
        for shape in data["shapes"]:
            assert len(shape["x"]) in (1, frames)
            assert all(0 <= frame < frames for frame in shape.get("active", []) + shape.get("visible", []))


def test_a_study_that_is_not_finished_is_reported_all_the_same(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    for name in ("qnets.npz", "qlearning.csv", "transfer.csv", "generalisation.csv"):
        run.file(name).unlink()
    page = report.write(tmp_path).read_text()
    assert page.count("missing</dt>") == 3  # figures 7, 8 and 9
    assert "Nothing to watch yet: no run has" in page
    assert NO_DATA.why in page


def test_a_damaged_file_is_named(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    run.file("actions.npz").write_bytes(b"PK")
    run.file("history.csv").write_text("generation,episodes\n0,16\n")
    page = report.write(tmp_path).read_text()
    assert "actions.npz is damaged" in page
    assert "history.csv is damaged, or was changed: run `qboot evolve --out" in page


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("lineage.npz", ["lineage"]),
        ("actions.npz", ["segments", "durations", "inputs"]),
        ("sensors.npz", ["segments", "durations", "inputs"]),
        ("qlearning.csv", ["QL best", "episodes to 6", "QL mean of last 100"]),
        ("generalisation.csv", ["ER on new domains", "QL on new domains"]),
    ],
)
@pytest.mark.parametrize("is_damaged", [False, True])
def test_a_file_that_is_missing_leaves_dashes_in_its_own_columns(tiny_run, tmp_path, name, columns, is_damaged):
    run = copied(tiny_run, tmp_path)
    head = tables.header(run)
    whole = dict(zip(head, tables.row(run), strict=True))
    run.file(name).write_bytes(b"PK") if is_damaged else run.file(name).unlink()
    assert dict(zip(head, tables.row(run), strict=True)) == whole | dict.fromkeys(columns, "-")
    assert whole["segments"].isdecimal() and whole["inputs"].isdecimal()


def test_nothing_but_a_configuration_is_reported(tmp_path):
    runs.create(tmp_path / "box_pushing" / "A-0", profiles.settings_of("box_pushing", "smoke", "A", 0))
    page = report.write(tmp_path).read_text()
    assert page.count("data:image/png") == 2  # the environment and the domains
    assert "Nothing to watch yet" in page


def test_one_unreadable_run_does_not_hide_the_others(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    for name, text in (("B-0", "{"), ("C-0", '{"format": 0}')):
        run.folder.with_name(name).mkdir()
        (run.folder.with_name(name) / "config.json").write_text(text)
    lost = run.folder.with_name("A-1")
    runs.create(lost, replace(run.settings, task=f"{tmp_path}/gone.py:TASK"))
    page = report.write(tmp_path).read_text()
    assert page.count("data:image/png;base64,") == 7
    assert "3 runs could not be read" in page
    listed = page[page.index('<h2 id="unreadable">') :]
    assert re.findall(r"<li>\S*ball_collecting/(\S+)/config.json", listed) == ["A-1", "B-0", "C-0"]
    assert "there is no file" in listed and "is damaged" in listed and "is of format 0" in listed
    shutil.rmtree(run.folder)
    with pytest.raises(RunError, match=r"no run below .* can be read: .*A-1.config.json: "):
        report.write(tmp_path)


def test_an_unreadable_cell_hides_no_other_one(tiny_study, tmp_path):
    study = tmp_path / "study"
    shutil.copytree(tiny_study, study)
    (study / "ablations" / "ball_collecting" / "sensors" / "random" / "0" / "config.json").write_text("{")
    page = report.write(study).read_text()
    for name in catalogue.CONTROL_PLOTS:
        assert f'id="ball_collecting-figure-{name}"' in page
    assert re.search(r"<li>\S*sensors/random/0/config.json is damaged", page)


def test_what_a_task_does_not_have_leaves_nothing_empty(bare_study):
    page = report.write(bare_study).read_text()
    headings = re.findall(r"<h3[^>]*>(.*?)</h3>", page)
    assert headings == [
        "How commands are cut into actions", "Learning on the source set", "Generalisation to new domains",
        "Learning on the target set", "Control experiments (section VII, appendix A)", "Where the actions come from",
        "Sensors for the state", "The number of actions", "Numbers", "Sizes", "Runs",
    ]  # fmt: skip
    assert page.count("data:image/png;base64,") == 7 and players_of(page) == []
    for table in re.findall(r"<table.*?</table>", page, re.S):
        assert table.count("<td") > 0
    content = page[page.index("<h2") :]
    assert "paper" not in content and "verdict" not in content and "How numbers are compared" not in content


def test_without_a_paper_our_numbers_stand_alone(bare_study):
    some = runs.find(bare_study)
    rows = verdicts.rows(some)
    assert [row.measure for row in rows] == list(measures.RUN_MEASURES)
    assert {row.verdict for row in rows} == {NO_PAPER} and not any(row.printed for row in rows)
    assert verdicts.findings(some) == []
    assert {(size.paper, size.is_reduced) for size in sizes.rows(some)} == {(None, False)}


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(RunError, match="no runs below"):
        report.write(tmp_path)


def test_wall_times_are_summed_over_starts(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    run.file("timing.csv").write_text("evolve,40.0\nevolve,20.5\nlearn,7200\n")
    page = report.write(tmp_path).read_text()
    assert "<small>60 s</small>" in page and "<small>2.0 h</small>" in page


def test_a_figure_is_a_command(tiny_run, tmp_path, capsys):
    study = str(tiny_run.folder.parents[1])
    assert catalogue.command(8, [study, "--out", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert catalogue.command(14, [study, "--out", str(tmp_path / "none.png")]) == 2
    assert "needs runs of box_pushing" in capsys.readouterr().err
    assert catalogue.command(8, [str(tmp_path), "--out", str(tmp_path / "none.png")]) == 2
    assert "no runs below" in capsys.readouterr().err
    assert not (tmp_path / "none.png").exists()
    with pytest.raises(ValueError, match="has a figure 20"):
        catalogue.command(20, [])


def test_every_figure_of_a_paper_is_in_the_catalogue():
    numbers = {}
    for name in registry.BUILT_IN:
        task = get_task(name)
        printed = task.paper().figures
        assert set(printed) <= set(catalogue.names_of(task)) | set(catalogue.CONTROL_PLOTS)
        numbers[name] = sorted(figure.number for figure in printed.values())
    assert numbers == {
        "ball_collecting": [*range(3, 10), 17, 18, 19],
        "box_pushing": [*range(10, 17), 17, 18, 19],
    }


def test_figures_come_in_the_papers_order_then_the_others():
    assert catalogue.names_of(get_task("box_pushing")) == [
        "environment", "domains", "evolved_behaviour", "learned_behaviour", "learning_on_source", "generalisation",
        "learning_on_target", "segmentation",
    ]  # fmt: skip
    assert catalogue.names_of(bare(get_task("box_pushing"))) == [
        "segmentation", "learning_on_source", "generalisation", "learning_on_target",
    ]  # fmt: skip


def test_a_shape_that_is_never_active_can_be_drawn():
    shape = drawing.Shape("robot", np.zeros(4), np.zeros(4), 1.0, None, "#000000")
    assert drawing.is_active(shape).tolist() == [False] * 3
    assert drawing.is_active(shape._replace(active=np.array([True]))).tolist() == [True] * 3
    assert drawing.is_active(shape._replace(active=np.array([True, False, True, False]))).tolist() == [
        False, True, False,
    ]  # fmt: skip


def test_recordings_are_what_was_scored(tiny_run):
    task, best = task_of(tiny_run), read_lineage(tiny_run).take(slice(-1, None))
    found = recordings.evolved(tiny_run)
    assert sum(recordings.scores(task, recording)[-1] for recording in found) == best.scores[0]
    for recording in [*found, *recordings.learned(tiny_run)]:
        assert len(recording.states.reward) <= tiny_run.settings.n_steps + 1
        np.testing.assert_array_equal(recording.states.posture.x[0], recording.domain.start[0])


@pytest.mark.slow
def test_any_rollout_is_played_from_one_start_by_both(tmp_path):
    """On the arm, whose rollouts start at random, several in each domain."""
    settings = tiny_settings("box_pushing", physics="kinematic", n_steps=40, episodes=1)
    run = runs.create(tmp_path / "box_pushing" / "A-0", settings)
    for stage in STAGES[:3]:
        stage.do(run)
    networks, policies = recordings.evolved(run), recordings.learned(run)
    task = task_of(run)
    assert len(networks) == len(policies) == 3 * task.rollouts_per_domain > 3
    starts = [recording.states.hand[0] for recording in networks]
    np.testing.assert_array_equal(starts, [recording.states.hand[0] for recording in policies])
    np.testing.assert_array_equal(
        [recording.states.block[0] for recording in networks], [recording.states.block[0] for recording in policies]
    )
    assert len(np.unique(starts, axis=0)) == len(starts)
    firsts = recordings.first_of_domains(task, networks)
    assert len(firsts) == 3 and firsts[1] is networks[task.rollouts_per_domain]
    made = player.player(run)
    assert len(made.replays) == len(starts)
    assert made.replays[task.rollouts_per_domain + 1].title.startswith("domain 1, rollout 1: network ")
    assert all(len(replay.data) == len(made.who) == 2 for replay in made.replays)


def test_a_page_of_many_rollouts_keeps_fewer_frames_of_each(tiny_run, monkeypatch):
    monkeypatch.setattr(player, "MAX_FRAMES_OF_PAGE", 40)
    for replay in player.player(tiny_run).replays:
        assert [len(data["steps"]) for data in replay.data] == [10, 10]


def test_a_policy_is_recorded_with_its_actions(tiny_run):
    for recording in recordings.learned(tiny_run):
        assert len(recording.actions) == len(recording.states.reward) - 1
        assert recording.actions.max() < 17


def test_a_player_keeps_scores_flags_and_the_end(tiny_run):
    task, recording = task_of(tiny_run), recordings.evolved(tiny_run)[0]
    n_states = len(recording.states.reward)
    states = recording.states._replace(
        reward=np.where(np.isin(np.arange(n_states), (30, 60)), task.reward, 0.0),
        carried=(np.arange(n_states)[:, None] >= 20) & (np.arange(n_states)[:, None] < 30) & np.ones(4, bool),
    )
    scene = task.view.scene(recording.domain, states)
    data = player.as_data(task, recording._replace(states=states), scene, max_frames=n_states)
    assert (data["scored"], data["scores"]) == ([30, 60], [1, 2])
    assert data["shapes"][data["movers"][0]]["active"] == [20, 30]
    thin = player.as_data(task, recording._replace(states=states), scene, max_frames=7)
    assert len(thin["steps"]) == 7 and thin["steps"][-1] == n_states - 1
    assert len(thin["scores"]) == 2


def test_a_replay_is_a_page_of_its_own(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    page = player.write(run).read_text()
    assert page.count("<canvas") == 2 and page.count("<option value") == 2 + 3 and "http" not in page
    run.file("qnets.npz").unlink()
    with pytest.raises(RunError, match=r"qnets.npz does not exist: run `qboot learn --out"):
        player.write(run)


def test_a_task_that_is_not_drawn_has_no_replay(bare_study):
    with pytest.raises(RunError, match="bare does not say how it is drawn"):
        player.write(runs.find(bare_study)[0])


def test_runs_of_the_papers_size_are_compared(paper_sized):
    rows = {row.measure: row for row in verdicts.rows(paper_sized)}
    generations = rows["generations to the top score"]
    assert generations.quartiles == (198, 287, 586)
    assert (generations.verdict.answer, generations.not_reached) == (AGREES, 0)
    assert rows["generalisation of ER"].verdict.answer == AGREES
    assert rows["generalisation of Q-learning"].value == 12
    assert rows["lineage of the best-of-run"].verdict == NO_DATA
    late = rows["Q-learning episodes to the top score, target"]  # one of five runs scores 24
    assert (late.value, late.not_reached, late.verdict.answer) == (np.inf, 4, DIFFERS)
    unknown = rows["ER episodes to the top score, target"]  # given 128,256 episodes, the paper's took more
    assert (unknown.not_reached, unknown.verdict.answer) == (5, CANNOT_TELL)


def test_conclusions_are_tested(paper_sized):
    better, faster, faster_than_transfer = verdicts.findings(paper_sized)
    assert better.medians == (12, 2) and better.verdict.answer == AGREES
    assert faster.medians == (22, 7) and faster.verdict.answer == AGREES
    assert faster_than_transfer.comparison.a12 == 0.5 and faster_than_transfer.verdict.answer == CANNOT_TELL


def test_few_or_small_runs_are_not_compared(paper_sized, tiny_run):
    assert verdicts.rows(paper_sized[:4])[0].verdict.answer == CANNOT_TELL
    assert verdicts.findings(paper_sized[:4])[0].verdict.answer == CANNOT_TELL
    small = [Run(run.folder, tiny_settings()) for run in paper_sized]
    assert verdicts.rows(small)[0].verdict.answer == CANNOT_TELL


def test_an_evolution_that_reached_the_top_was_long_enough(paper_sized):
    """Of 300 generations, for what is done with its runs; those that never got there were not."""
    assert verdicts.shortfall(paper_sized, (EVOLVED,)) == ""
    evolution = replace(paper_sized[0].settings.evolution, generations=300)
    short = [Run(run.folder, replace(run.settings, evolution=evolution)) for run in paper_sized]
    for run in short:
        record_all(run)
    assert verdicts.shortfall(short, ("generations",)) == "generations on the source set: 300 of 1,000"
    assert verdicts.shortfall(short, (EVOLVED,)) == ""
    run = short[0]
    history = files.read_csv(run.file("history.csv"))
    files.write_csv(run.file("history.csv"), history | {"best": np.full(len(history["best"]), 7.0)})
    record_all(run)
    words = "1 of 5 runs have neither the paper's generations nor the top score"
    assert verdicts.shortfall(short, (EVOLVED,)) == words


@pytest.mark.parametrize(
    ("result", "values", "expected"),
    [
        (Result("", "", 5), [1, 4, 5, 6, 9], AGREES),
        (Result("", "", 9), [1, 4, 5, 6, 9], DIFFERS),
        (Result("", "", 6, 5.5, 7), [1, 4, 5, 6, 9], DIFFERS),  # our 5 is outside the paper's quartiles
        (Result("", "", 6, statistic="mean"), [1, 4, 5, 6, 14], AGREES),
        (Result("", "", None), [1, 4, 5, 6, 9], CANNOT_TELL),
        (Result("", "", 5), [1, 4, 5, 6], CANNOT_TELL),
    ],
)
def test_the_rule_for_numbers(result, values, expected):
    summary = measures.over_values([np.array(values, float)])
    value = summary.mean if result.statistic == "mean" else summary.quartiles.median
    verdict = rules.judge_number(result, value, summary.quartiles, len(values), summary.given, "")
    assert verdict.answer == expected


@pytest.mark.parametrize(
    ("times", "given", "expected"),
    [
        ([50, 50, 50, 50, 50], 99, (DIFFERS, 50)),
        ([20, 90, 110, 200, 200], 130, (AGREES, 110)),
        # A median that was never reached agrees with no number, however wide the spread.
        ([20, 30, 200, 200, 200], 130, (DIFFERS, np.inf)),
        ([200] * 5, 99, (CANNOT_TELL, np.inf)),
        ([200] * 5, 100, (DIFFERS, np.inf)),
    ],
)
def test_the_rule_for_times(times, given, expected):
    episodes = np.arange(1, given + 1)
    climbs = [measures.Climb(Curve(episodes, np.where(episodes >= time, 8.0, 0.0)), 8.0) for time in times]
    summary = measures.over_climbs(climbs)
    value = summary.quartiles.median
    verdict = rules.judge_number(Result("", "", 100), value, summary.quartiles, 5, summary.given, "")
    assert (verdict.answer, value) == expected


def test_a_time_is_when_the_median_gets_there_and_not_a_lucky_episode():
    """Each of three runs has its lucky episode; two have the top score at once in the seventh alone."""
    scores = np.zeros((3, 9))
    scores[[0, 1, 2, 0, 1], [1, 2, 4, 6, 6]] = 8.0
    summary = measures.over_climbs([measures.Climb(Curve(np.arange(1, 10), row), 8.0) for row in scores])
    assert summary.quartiles.median == 7 and summary.quartiles.lower == 7 and summary.quartiles.upper == np.inf
    assert (summary.not_reached, summary.given) == (0, 9)
    medians = np.median(scores, axis=0)
    assert np.flatnonzero(medians >= 8)[0] + 1 == 7


@pytest.mark.parametrize(
    ("a12", "p_value", "top", "n_runs", "expected"),
    [
        (0.9, 0.01, 3, 5, AGREES),
        (0.9, 0.2, 3, 5, CANNOT_TELL),
        (0.9, 0.2, 3, 30, DIFFERS),
        (0.1, 0.01, 3, 5, DIFFERS),
        (0.5, 1.0, 0, 30, CANNOT_TELL),
    ],
)
def test_the_rule_for_an_order(a12, p_value, top, n_runs, expected):
    assert rules.judge_order(Comparison(p_value, a12), top, n_runs, "").answer == expected


@pytest.mark.parametrize(
    ("interval", "p_value", "top", "expected"),
    [
        ((-0.9, 1.0), 0.5, 8, AGREES),
        ((0.1, 0.4), 0.001, 8, AGREES),  # there is a difference, of no importance
        ((-0.9, 1.1), 0.5, 8, CANNOT_TELL),
        ((0.2, 3.0), 0.01, 8, DIFFERS),
        ((0.0, 0.0), 1.0, 0, CANNOT_TELL),
    ],
)
def test_the_rule_for_no_difference(interval, p_value, top, expected):
    assert rules.judge_same(Comparison(p_value, 0.5), interval, 1.0, top, 10, "").answer == expected
    assert rules.judge_same(Comparison(p_value, 0.5), interval, 1.0, top, 4, "").answer == CANNOT_TELL


def test_every_number_of_the_paper_can_be_measured():
    papers = [get_task(name).paper() for name in registry.BUILT_IN]
    named = {result.measure for paper in papers for result in paper.results}
    named |= {side for paper in papers for row in paper.conclusions for side in (row.first, row.second)}
    assert named == set(measures.RUN_MEASURES)
    for measure in measures.RUN_MEASURES.values():
        assert set(measure.needs) <= {*sizes.LABELS, EVOLVED}


def test_a_moving_mean_starts_with_what_there_is():
    found = moving_mean(Curve(np.arange(4), np.array([2.0, 4, 6, 8])), 2)
    np.testing.assert_array_equal(found.scores, [2, 3, 5, 7])


@pytest.mark.parametrize(
    ("value", "text"), [(np.inf, "never"), (np.nan, "–"), (1263360, "1,263,360"), (7.5, "7.5"), (0.04804, "0.048")]
)
def test_numbers_for_people(value, text):
    assert templating.as_number(value) == text
