"""What `qboot reproduce` would do, and what it would cost: nothing is started, nothing is written."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from qboot.envs.registry import get_task
from qboot.study.calibration import measure
from qboot.study.costs import Costs, seconds_of
from qboot.study.jobs import Job, jobs_of, waits_for
from qboot.study.pipeline.profiles import size_of

HOUR = 3600.0


def lines(profile: str, task: str | None, out: Path, physics: str | None = None) -> Iterable[str]:
    """A table of the jobs, sums by task and kind, and on the last line the core-hours left on this machine.

    Raises:
        ValueError: for an unknown task, profile or physics.
    """
    table = jobs_of(profile, task, out, physics)
    left = dict.fromkeys(job.task for job in table if not job.is_done)
    sizes = {name: size_of(get_task(name), profile).n_steps for name in left}
    return described(table, {name: measure(get_task(name, physics), n_steps) for name, n_steps in sizes.items()})


def described(table: list[Job], costs: Mapping[str, Costs]) -> Iterable[str]:
    """The lines for a table of jobs, given the costs by task of those that are left."""
    yield _row("job", "state", "core-hours")
    by_kind: dict[str, float] = {}
    for job in table:
        hours = 0.0 if job.is_done else sum(seconds_of(job, costs[job.task]).values()) / HOUR
        yield _row(job.label, _state(job, table), f"{hours:.4f}")
        kind = job.task_name, f"{job.task_name} {job.step if job.run else job.what}"
        for name in kind:
            by_kind[name] = by_kind.get(name, 0.0) + hours
    yield ""
    for name, rates in costs.items():
        measured = ", ".join(f"{rate.replace('_', ' ')} {value:.3g}" for rate, value in rates._asdict().items())
        yield f"measured, {get_task(name).name}: {measured}"
    yield ""
    for name, hours in by_kind.items():
        yield _row(name, "", f"{hours:.4f}")
    yield f"{sum(by_kind[name] for name in {job.task_name for job in table}):.2f} core-hours"


def _state(job: Job, table: list[Job]) -> str:
    if job.is_done:
        return "done"
    return "ready" if all(other.is_done for other in waits_for(job, table)) else "waits"


def _row(name: str, state: str, value: str) -> str:
    return f"{name:44} {state:6} {value:>12}"
