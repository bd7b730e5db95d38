"""What is published of a study, and the page of results: the same numbers and figures as from the study itself."""

import re
import shutil

import pytest
from conftest import claims_of, record_all

from qboot import cli
from qboot.study.analysis import verdicts
from qboot.study.analysis.rules import CANNOT_TELL
from qboot.study.controls.cells import find
from qboot.study.controls.conditions import WHATS
from qboot.study.report import page, results
from qboot.study.store import publishing, runs
from qboot.study.store.files import RunError

OF_Q_NETWORKS = ("learned_behaviour",)


@pytest.fixture(scope="module")
def published(tiny_study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("published") / "study"
    assert cli.main(["publish", "--out", str(tiny_study), "--to", str(folder)]) == 0
    return folder


def pictures(text):
    """The pictures of a report by the anchor of their figure."""
    parts = re.split(r'id="ball_collecting-figure-', text)[1:]
    return {part.split('"')[0]: re.findall(r"data:image/png;base64,([^\"]+)", part) for part in parts}


def test_a_report_on_what_is_published_has_the_same_figures(tiny_study, published, tmp_path):
    whole, copy = tmp_path / "whole", tmp_path / "copy"
    shutil.copytree(tiny_study, whole)
    shutil.copytree(published, copy)
    of_whole, of_copy = (pictures(page.write(folder).read_text()) for folder in (whole, copy))
    for name, drawn in of_whole.items():
        assert len(drawn) == 1 and of_copy[name] == ([] if name in OF_Q_NETWORKS else drawn), name
    assert "qnets.npz" in (copy / "report.html").read_text()
    for folder in (whole, copy):  # no stage is called missing for a file that is never published
        assert '<td class="number">missing' not in (folder / "report.html").read_text()


def test_what_is_published_is_all_but_q_networks_and_gives_the_same_numbers(tiny_study, published):
    names = {path.name for path in published.rglob("*") if path.is_file()}
    assert names == {*publishing.CONTENTS, publishing.CHECKSUMS, "config.json", "files.json"}
    said = [
        [
            repr((row.measure, row.value, row.quartiles, row.interval, row.verdict))
            for row in verdicts.rows(runs.find(study))
        ]
        for study in (tiny_study, published)
    ]
    assert said[0] == said[1]


def test_a_changed_file_is_found(published, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(published, copy)
    assert publishing.changed_files(copy) == []
    (copy / "ball_collecting/A-0/history.csv").write_text("generation,episodes,best\n0,1,8\n")
    (copy / "ball_collecting/A-0/transfer.csv").unlink()
    assert publishing.changed_files(copy) == ["ball_collecting/A-0/history.csv", "ball_collecting/A-0/transfer.csv"]


def test_a_folder_is_not_published_over(tiny_study, published):
    with pytest.raises(RunError, match="exists already"):
        publishing.publish(tiny_study, published)
    with pytest.raises(RunError):
        publishing.publish(published / "none", published / "new")


@pytest.fixture
def timed(tiny_study, tmp_path):
    """A copy of the study that may be changed, as a runner leaves it: with times beside what was made."""
    study = tmp_path / "studies" / "timed"
    shutil.copytree(tiny_study, study)
    for folder in ("ball_collecting/A-0", "ablations/ball_collecting/sensors", "ablations/box_pushing/sensors"):
        (study / folder).mkdir(parents=True, exist_ok=True)
        (study / folder / "timing.csv").write_text("evolve,1.0\n")
    return study


def test_times_are_published_of_what_is_published(timed, tmp_path):
    publishing.publish(timed, tmp_path / "new" / "out")
    times = {str(path.relative_to(tmp_path / "new" / "out")) for path in tmp_path.rglob("new/out/**/timing.csv")}
    # Box pushing has no cells: the times of such as began and left nothing are nobody's.
    assert times == {"ball_collecting/A-0/timing.csv", "ablations/ball_collecting/sensors/timing.csv"}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("ball_collecting/A-0/lineage.npz", b"PK"),
        ("ball_collecting/A-0/files.json", b"{"),
        ("ball_collecting/B-0/config.json", b"{"),
        ("ablations/ball_collecting/sensors/random/0/qlearning.csv", b"episode,score\n"),
        ("ablations/ball_collecting/sensors/random/0/config.json", b"{"),
    ],
)
def test_of_a_study_with_a_damaged_file_nothing_is_published(timed, tmp_path, name, content):
    path, out = timed / name, tmp_path / "new" / "out"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    (path.parent / "timing.csv").write_text("evolve,1.0\n")
    with pytest.raises(RunError, match=str(path.parent)):
        publishing.publish(timed, out)
    assert not out.parent.exists()


def test_cells_of_a_run_that_was_made_anew_are_not_published(timed, tmp_path):
    [run] = runs.find(timed)
    run.file("lineage.npz").write_bytes(run.file("lineage.npz").read_bytes() + b" ")
    record_all(run)
    with pytest.raises(RunError, match=r"ablations/.* was made with other settings, or from other files"):
        publishing.publish(timed, tmp_path / "out")


def test_a_copy_that_fails_halfway_leaves_nothing(timed, tmp_path, monkeypatch):
    def copyfile(source, target):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space"):
        patch.setattr(publishing.shutil, "copyfile", copyfile)
        publishing.publish(timed, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["studies"]
    assert publishing.publish(timed, tmp_path / "out") > 0


def test_every_claim_has_an_answer_and_a_reason(tiny_study):
    some = runs.find(tiny_study)
    found = claims_of({what: find(tiny_study, "ball_collecting", what) for what in WHATS}, some)
    assert len(found) == 11 + 3 + 10
    assert all(claim.verdict.why and claim.printed and claim.section for claim in found)
    assert {claim.verdict.answer for claim in found} == {CANNOT_TELL}  # one tiny run tells nothing
    assert {claim.n for claim in found} == {1, 2}


def test_the_page_of_results_is_made_between_its_marks(tiny_study, published, tmp_path):
    path = results.write(tiny_study, tmp_path / "docs")
    made = path.read_text()
    assert made.count("cannot be told**") == 24 and "Of the paper's 24 claims 0 agree, 0 differ" in made
    pictured = re.findall(r"!\[[^]]*\]\((figures/[^)]+)\)", made)
    assert [name[len("figures/fig") :][:2] for name in pictured] == ["06", "08", "09", "17", "18", "19"]
    path.write_text("# Results\n\nBefore.\n" + made.removeprefix("# Results\n\n") + "\nAfter.\n")
    digests = {name: (path.parent / name).read_bytes() for name in pictured}
    again = results.write(published, tmp_path / "docs").read_text()
    assert again.startswith("# Results\n\nBefore.\n" + results.START) and again.endswith("\nAfter.\n")
    assert made.removeprefix("# Results\n\n").strip() in again
    assert {name: (path.parent / name).read_bytes() for name in pictured} == digests
    path.write_text("by hand")
    with pytest.raises(RunError, match="lacks the marks"):
        results.write(tiny_study, tmp_path / "docs")
