"""The report, its figures and its replays: complete, self-contained, honest about what is missing."""

import json
import re
import shutil

import numpy as np
import pytest
from conftest import tiny_settings
from qboot.study.analysis.paper import Result
from qboot.study.pipeline.stages import read_lineage, task_of

from qboot.study.analysis import measures, paper, recordings, sizes, verdicts
from qboot.study.analysis.curves import Curve, moving_mean
from qboot.study.analysis.measures import Sample
from qboot.study.analysis.statistics import Comparison
from qboot.study.analysis.verdicts import AGREES, DIFFERS, NO_DATA, NO_NUMBER, NOT_COMPARABLE
from qboot.study.figures.catalogue import catalogue as figures
from qboot.study.pipeline import profiles
from qboot.study.report.page import page as report
from qboot.study.report.page import player as replay
from qboot.study.store import files, runs
from qboot.study.store.files import RunError
from qboot.study.store.runs import Run

REACHED = (150, 198, 287, 586, 700)  # generations; their quartiles are the paper's


def copied(run, folder):
    """A copy of a run, as a study of its own that may be changed."""
    shutil.copytree(run.folder, folder / "ball_collecting" / "A-0")
    return runs.load(folder / "ball_collecting" / "A-0")


def players_of(page):
    return [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)]


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
    return runs.find(tmp_path)


def test_the_page_holds_every_figure_and_needs_nothing_else(page):
    assert page.count("data:image/png;base64,") == len(figures.PLOTS["ball_collecting"])
    for number in figures.PLOTS["ball_collecting"]:
        assert f'id="figure-{number}"' in page
    assert page.count("missing</dt>") == len(figures.ABLATION_PLOTS)  # this study has no control experiments
    assert not re.search(r'(src|href)="(?!data:|#)', page) and "@import" not in page and "url(" not in page
    assert len(page) < 3_000_000


def test_every_link_of_the_contents_leads_somewhere(page):
    for name in re.findall(r'href="#([^"]+)"', page):
        assert f'id="{name}"' in page


def test_reduced_sizes_are_said_on_top(page):
    assert "The sizes of this study are reduced" in page
    assert NOT_COMPARABLE in page and verdicts.AGREES not in re.findall(r'class="verdict (\w+)', page)


def test_the_page_plays_networks_and_policies(page):
    found = players_of(page)
    assert len(found) == 4
    for player in found:
        frames = len(player["steps"])
        assert player["steps"][0] == 0
        for shape in player["shapes"]:
            assert len(shape["x"]) in (1, frames)
            assert all(0 <= frame < frames for frame in shape.get("active", []) + shape.get("visible", []))


def test_a_study_that_is_not_finished_is_reported_all_the_same(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    for name in ("qnets.npz", "qlearning.csv", "transfer.csv", "generalisation.csv"):
        run.file(name).unlink()
    page = report.write(tmp_path).read_text()
    assert page.count("missing</dt>") == 6  # figures 7, 8 and 9, and the control experiments
    assert "No replay: no run has" in page
    assert NO_DATA in page


def test_a_damaged_file_is_named(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    run.file("actions.npz").write_bytes(b"PK")
    run.file("history.csv").write_text("generation,episodes\n0,16\n")
    page = report.write(tmp_path).read_text()
    assert "actions.npz is damaged" in page
    assert "history.csv has no values &#39;best&#39;" in page


def test_nothing_but_a_configuration_is_reported(tmp_path):
    runs.create(tmp_path / "box_pushing" / "A-0", profiles.settings_of("box_pushing", "smoke", "A", 0))
    page = report.write(tmp_path).read_text()
    assert page.count("data:image/png") == 2  # the environment and the domains
    assert "No replay" in page


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
    assert figures.command(8, [study, "--out", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert figures.command(14, [study, "--out", str(tmp_path / "none.png")]) == 2
    assert "needs runs of box_pushing" in capsys.readouterr().err
    assert figures.command(8, [str(tmp_path), "--out", str(tmp_path / "none.png")]) == 2
    assert "no runs below" in capsys.readouterr().err
    assert not (tmp_path / "none.png").exists()


def test_recordings_are_what_was_scored(tiny_run):
    task, best = task_of(tiny_run), read_lineage(tiny_run).take(slice(-1, None))
    found = recordings.evolved(tiny_run)
    assert sum(recordings.scores(task, recording)[-1] for recording in found) == best.scores[0]
    for recording in [*found, *recordings.learned(tiny_run)]:
        assert len(recording.states.reward) <= tiny_run.settings.n_steps + 1
        np.testing.assert_array_equal(recording.states.posture.x[0], recording.domain.start[0])


def test_a_policy_is_recorded_with_its_actions(tiny_run):
    for recording in recordings.learned(tiny_run):
        assert len(recording.actions) == len(recording.states.reward) - 1
        assert recording.actions.max() < 17


def test_a_replay_keeps_scores_flags_and_the_end(tiny_run):
    task, recording = task_of(tiny_run), recordings.evolved(tiny_run)[0]
    n_states = len(recording.states.reward)
    states = recording.states._replace(
        reward=np.where(np.isin(np.arange(n_states), (30, 60)), task.reward, 0.0),
        carried=(np.arange(n_states)[:, None] >= 20) & (np.arange(n_states)[:, None] < 30) & np.ones(4, bool),
    )
    scene = replay.LOOKS[task.name].scene(recording.domain, states)
    data = replay.as_data(task, recording._replace(states=states), scene, max_frames=n_states)
    assert data["scores"] == [30, 60]
    assert data["shapes"][data["movers"][0]]["active"] == [20, 30]
    thin = replay.as_data(task, recording._replace(states=states), scene, max_frames=7)
    assert len(thin["steps"]) == 7 and thin["steps"][-1] == n_states - 1
    assert len(thin["scores"]) == 2


def test_a_replay_is_a_page_of_its_own(tiny_run, tmp_path):
    run = copied(tiny_run, tmp_path)
    page = replay.write(run).read_text()
    assert page.count("<canvas") == 4 and "http" not in page
    run.file("qnets.npz").unlink()
    with pytest.raises(RunError, match="run the stage that makes it first"):
        replay.write(run)


def test_runs_of_the_papers_size_are_compared(paper_sized):
    rows = {row.result.measure: row for row in verdicts.rows(paper_sized)}
    generations = rows["generations to the top score"]
    assert generations.quartiles == (198, 287, 586)
    assert (generations.verdict, generations.not_reached) == (AGREES, 0)
    assert rows["generalisation of ER"].verdict == AGREES
    assert rows["generalisation of Q-learning"].value == 12
    assert rows["lineage of the best-of-run"].verdict == NO_DATA
    late = rows["Q-learning episodes to the top score, target"]  # one of five runs scores 24
    assert (late.value, late.not_reached, late.verdict) == (np.inf, 4, DIFFERS)
    unknown = rows["ER episodes to the top score, target"]  # given 128,256 episodes, the paper's took more
    assert (unknown.not_reached, unknown.verdict) == (5, NOT_COMPARABLE)


def test_conclusions_are_tested(paper_sized):
    better, faster, faster_than_transfer = verdicts.findings(paper_sized)
    assert better.medians == (12, 2) and better.verdict == AGREES
    assert faster.medians == (22, 7) and faster.verdict == AGREES
    assert faster_than_transfer.comparison.a12 == 0.5 and faster_than_transfer.verdict == DIFFERS


def test_few_or_small_runs_are_not_compared(paper_sized, tiny_run):
    assert verdicts.rows(paper_sized[:4])[0].verdict == NOT_COMPARABLE
    assert verdicts.findings(paper_sized[:4])[0].verdict == NOT_COMPARABLE
    small = [Run(run.folder, tiny_settings()) for run in paper_sized]
    assert verdicts.rows(small)[0].verdict == NOT_COMPARABLE


@pytest.mark.parametrize(
    ("result", "values", "given", "expected"),
    [
        (Result("", "", 5), [1, 4, 5, 6, 9], np.inf, AGREES),
        (Result("", "", 9), [1, 4, 5, 6, 9], np.inf, DIFFERS),
        (Result("", "", 6, 5.5, 7), [1, 4, 5, 6, 9], np.inf, DIFFERS),  # our 5 is outside the paper's quartiles
        (Result("", "", 6, statistic="mean"), [1, 4, 5, 6, 14], np.inf, AGREES),
        (Result("", "", None), [1, 4, 5, 6, 9], np.inf, NO_NUMBER),
        (Result("", "", 100), [np.inf] * 5, 99, NOT_COMPARABLE),
        (Result("", "", 100), [np.inf] * 5, 100, DIFFERS),
        (Result("", "", 100), [20, 90, 120, np.inf, np.inf], 130, AGREES),
    ],
)
def test_the_rule_for_numbers(result, values, given, expected):
    assert verdicts.judge(result, Sample(np.array(values, float), given), 5, True) == expected


@pytest.mark.parametrize(
    ("a12", "p_value", "top", "expected"),
    [
        (0.9, 0.01, 3, AGREES),
        (0.9, 0.2, 3, DIFFERS),
        (0.1, 0.01, 3, DIFFERS),
        (0.5, 1.0, 0, NOT_COMPARABLE),
    ],
)
def test_the_rule_for_conclusions(a12, p_value, top, expected):
    assert verdicts.judge_order(Comparison(p_value, a12), top, 5, True) == expected


def test_every_number_of_the_paper_can_be_measured():
    named = {result.measure for results in paper.RESULTS.values() for result in results}
    named |= {side for some in paper.CONCLUSIONS.values() for row in some for side in (row.greater, row.smaller)}
    assert named == set(measures.MEASURES)
    for measure in measures.MEASURES.values():
        assert set(measure.needs) <= set(sizes.LABELS)


def test_a_moving_mean_starts_with_what_there_is():
    found = moving_mean(Curve(np.arange(4), np.array([2.0, 4, 6, 8])), 2)
    np.testing.assert_array_equal(found.scores, [2, 3, 5, 7])


@pytest.mark.parametrize(
    ("value", "text"), [(np.inf, "never"), (np.nan, "–"), (1263360, "1,263,360"), (7.5, "7.5"), (0.04804, "0.048")]
)
def test_numbers_for_people(value, text):
    assert report.as_number(value) == text
