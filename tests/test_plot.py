"""`qboot plot`: the curves of a run, finished or at work; what cannot be shown is named in one line."""

import shutil

import pytest
from conftest import tiny_settings
from PIL import Image

from qboot.cli import main
from qboot.study.analysis.curves import source_curve, target_curve
from qboot.study.analysis.so_far import curves_so_far
from qboot.study.pipeline.progress import Progress
from qboot.study.pipeline.table import stage
from qboot.study.store import files, runs


@pytest.fixture
def run(tiny_run, tmp_path):
    """A copy of a finished run."""
    shutil.copytree(tiny_run.folder, tmp_path / "A-0")
    return runs.load(tmp_path / "A-0")


def refused(arguments, capsys):
    """The one line that a command ends with."""
    assert main(["plot", *map(str, arguments)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("qboot: ")
    return lines[0]


def interrupt(run, name, after, monkeypatch):
    """Do a stage until it has reported `after` times."""
    reported = []

    def update(*args, **kwargs):
        reported.append(args)
        if len(reported) == after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Progress, "update", update)
        with pytest.raises(KeyboardInterrupt):
            stage(name).do(run)


def test_a_finished_run_shows_both_sets(run, capsys):
    assert main(["plot", str(run.folder)]) == 0
    words = capsys.readouterr().out
    assert words.startswith(f"{run.file('curves.png')}: source set: Q-learning") and "; target set: Q-learning" in words
    with Image.open(run.file("curves.png")) as picture:
        assert picture.format == "PNG" and picture.width > 1.5 * picture.height


def test_the_picture_goes_where_it_is_wanted(run, tmp_path):
    out = tmp_path / "new" / "mine.png"
    assert main(["plot", str(run.folder), "--out", str(out)]) == 0
    assert out.exists() and not run.file("curves.png").exists()


def test_curves_are_those_of_the_finished_tables(run):
    for method, curve in curves_so_far(run, "source").items():
        assert (curve.scores == source_curve(run, method).scores).all()
    whole = {method: target_curve(run, method) for method in ("QL", "ER", "ER+transfer")}
    run.file("transfer.csv").unlink()  # the tables that it is made of stay
    for method, curve in curves_so_far(run, "target").items():
        assert (curve.scores == whole[method].scores).all() and (curve.episodes == whole[method].episodes).all()


def test_a_run_at_work_shows_what_it_has_saved(tmp_path, monkeypatch, capsys):
    run = runs.create(tmp_path / "A-0", tiny_settings())
    assert "has no curve yet" in refused([run.folder], capsys)
    interrupt(run, "evolve", after=2, monkeypatch=monkeypatch)
    found = curves_so_far(run, "source")
    assert list(found) == ["ER"] and len(found["ER"].episodes) == 3  # the first population and two generations
    assert main(["plot", str(run.folder)]) == 0
    assert "source set: ER (evolution)" in capsys.readouterr().out
    stage("evolve").do(run)
    assert (source_curve(run, "ER").scores[:3] == found["ER"].scores).all()


@pytest.mark.parametrize(
    ("name", "words"),
    [("history.csv", "is damaged, or was changed"), ("qlearning.csv", "is damaged"), ("transfer.csv", "is damaged")],
)
def test_a_half_written_table_is_named(run, capsys, name, words):
    content = run.file(name).read_bytes()
    run.file(name).write_bytes(content[: len(content) // 2])
    assert f"{run.file(name)} {words}" in refused([run.folder], capsys)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 half an archive"])
def test_a_half_written_checkpoint_is_named(run, capsys, content):
    run.file("qlearning.csv").unlink()
    run.file("learn.checkpoint.npz").write_bytes(content)
    assert "learn.checkpoint.npz is damaged" in refused([run.folder], capsys)


def test_a_checkpoint_of_another_version_is_named(run, capsys):
    run.file("history.csv").unlink()
    files.write_npz(run.file("evolve.checkpoint.npz"), {})
    assert "evolve.checkpoint.npz lacks history.episodes" in refused([run.folder], capsys)


def test_what_is_no_run_or_no_picture_is_named(run, tmp_path, capsys):
    assert "no run folder" in refused([tmp_path / "nowhere"], capsys)
    assert "ends in .png" in refused([run.folder, "--out", tmp_path / "x.pdf"], capsys)
    (tmp_path / "x.png").mkdir()
    assert "cannot be written" in refused([run.folder, "--out", tmp_path / "x.png"], capsys)
