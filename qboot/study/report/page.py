"""The report on a study: one self-contained HTML page with our numbers and figures, the paper's beside them."""

from collections.abc import Callable
from pathlib import Path

from qboot.study.analysis import rules
from qboot.study.pipeline.table import STAGES
from qboot.study.report.sections import section
from qboot.study.report.templating import PAGES
from qboot.study.store import files, runs
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings


def write(out: Path) -> Path:
    """Write OUT/report.html on all runs below `out`; what is missing or cannot be read is named in it.

    Raises:
        RunError: if there are no runs below `out`, or none can be read.
    """
    some, unreadable = runs.runs_below(out)
    by_task: dict[str, list[Run[RunSettings]]] = {}
    for run in some:
        by_task.setdefault(run.task_name, []).append(run)
    sections = [section(out, of_task) for of_task in by_task.values()]
    page = PAGES.get_template("report.html.jinja").render(
        sections=sections,
        profiles=sorted({run.settings.profile for run in some}),
        origins=origins(some),
        rules=rules.RULES if any(each.has_paper for each in sections) else (),
        stages=[stage.name for stage in STAGES],
        unreadable=unreadable,
    )
    path = out / "report.html"
    files.write_text(path, page)
    return path


def origins(some: list[Run[RunSettings]]) -> dict[str, list[str]]:
    """With what the runs were made: the different values that their configurations hold."""
    configs = [files.read_json(run.file("config.json")) for run in some]

    def different(read: Callable[[dict], str]) -> list[str]:
        return sorted({read(config) or "not known" for config in configs})

    packages = different(lambda config: ", ".join(f"{name} {v}" for name, v in config.get("packages", {}).items()))
    return {
        "qboot": different(lambda config: config.get("qboot", "")),
        "git commit (+: changed since)": different(lambda config: config.get("git_commit", "")),
        "Python": different(lambda config: config.get("python", "")),
        "packages": packages,
        "machine": different(lambda config: config.get("machine", "")),
        "XLA flags": different(lambda config: config.get("xla_flags", "")),
    }
