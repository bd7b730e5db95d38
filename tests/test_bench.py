"""The benchmarks: each kind runs, at a size of seconds, and tells what tables read."""

import sys
from pathlib import Path

import pytest

from experiments import bench, bench_beside, overhead, yardsticks
from qboot.study.pipeline import profiles
from qboot.study.store.runs import Run

SMALL = {
    "controllers": lambda: bench.controllers("ball_collecting", "fastsim", 2, max_steps=50),
    "networks": lambda: bench.networks(2, 4),
    "selection": lambda: bench.selection(8),
    "clustering": lambda: bench.clustering(60),
    "machine": bench.calibration,
}


@pytest.mark.parametrize("kind", SMALL)
def test_a_benchmark_runs(kind):
    found = SMALL[kind]()
    assert all(value >= 0 for value in found.values())
    assert kind == "machine" or len(set(found) & {*bench_beside.SECONDS, *bench_beside.RATES}) == 1


def test_two_checkouts_are_compared_by_what_tells_one_time(tmp_path, monkeypatch, capsys):
    """The machine and the parts of an episode are left out; a benchmark that tells no time ends nothing."""
    rows = {"machine": {"loop_us": 1}, "arm episode": {"step_us": 1}, "odd": {"points": 3}, "net": {"s": 2.0}}
    for name, seconds in (("before", 2.0), ("after", 1.0)):
        script = tmp_path / name / "experiments" / "bench.py"
        script.parent.mkdir(parents=True)
        script.write_text(
            "import json, sys\n"
            f"BENCHMARKS = {rows | {'net': {'s': seconds}}}\n"
            "if __name__ == '__main__':\n"
            "    lines = [json.dumps({'benchmark': name} | row) for name, row in BENCHMARKS.items()]\n"
            "    open(sys.argv[3], 'w').write('\\n'.join(lines))\n"
        )
    monkeypatch.setattr(sys, "argv", ["bench_beside.py", str(tmp_path / "before"), str(tmp_path / "after")])
    assert bench_beside.main() == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert lines == [["odd", "nan", "nan", "nan"], ["net", "2", "1", "0.50"]]


def test_a_generation_has_the_steps_of_all_rollouts():
    told = dict(zip(overhead.SETTINGS[::2], overhead.SETTINGS[1::2], strict=True))
    run = Run(Path(), profiles.settings_of(told["--task"], told["--profile"], "A", 0))
    n_rollouts = int(told["--evolution.population"]) * yardsticks.rollouts_per_episode(run)
    assert n_rollouts * int(told["--n-steps"]) == overhead.STEPS_OF_GENERATION


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in bench.BENCHMARKS if "sweep" not in name])
def test_every_benchmark_runs_at_its_own_size(name):
    assert all(value >= 0 for value in bench.BENCHMARKS[name]().values())
