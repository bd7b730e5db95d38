"""The benchmarks: each kind runs, at a size of seconds, and tells what tables read."""

import pytest

from experiments import bench, bench_beside

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


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in bench.BENCHMARKS if "sweep" not in name])
def test_every_benchmark_runs_at_its_own_size(name):
    assert all(value >= 0 for value in bench.BENCHMARKS[name]().values())
