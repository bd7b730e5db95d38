"""Tables of a study in Markdown: runs, learning in new domains, control experiments, tests, claims."""

import math
from collections.abc import Callable

import numpy as np

from qboot.study.analysis import appendix, sizes
from qboot.study.analysis.appendix import Table
from qboot.study.analysis.claims import Claim
from qboot.study.analysis.control_measures import (
    CellsByCondition,
    average_performance,
    common_episodes,
    n_inputs,
    performance,
    steps,
)
from qboot.study.analysis.curves import generalisation, score_at_the_end, top_score
from qboot.study.analysis.measures import RUN_MEASURES
from qboot.study.analysis.sizes import SizeRow
from qboot.study.analysis.statistics import quartiles
from qboot.study.analysis.words import as_number
from qboot.study.store import provenance
from qboot.study.store.artifacts import lineage_length, read_arrays, read_columns
from qboot.study.store.runs import Run
from qboot.study.store.settings import RunSettings

# What is measured of learning in new domains.
ON_TARGET = [name for name in RUN_MEASURES if name.endswith(", target")]
# Shares of the top score whose first time is given too: one of evolution, one of Q-learning.
HIGH, LEARNED = 0.85, 0.75


def goals(run: Run[RunSettings]) -> tuple[int, int, int]:
    """Scores whose first time is given: two of evolution, one of Q-learning."""
    top = int(top_score(run, "source"))
    return math.ceil(HIGH * top), top, math.ceil(LEARNED * top)


def header(run: Run[RunSettings]) -> list[str]:
    """The columns of the table of a task that `run` is of."""
    high, top, learned = goals(run)
    return [
        "run", f"generations to {high}", f"to {top}", "last best", "lineage", "segments", "durations", "inputs",
        "QL best", f"episodes to {learned}", "QL mean of last 100", "ER on new domains", "QL on new domains",
    ]  # fmt: skip


def first_at_least(values: list[str], score: float, positions: list[str]) -> str:
    """The position at which a value first reaches a score, or a dash."""
    reached = [position for value, position in zip(values, positions, strict=True) if float(value) >= score]
    return reached[0] if reached else "-"


def row(run: Run[RunSettings]) -> list[str]:
    """The cells of a run that has history.csv; dashes stand for what can only be read from files that it lacks."""

    def cells(read: Callable[[Run[RunSettings]], list[str]], n: int, *needed: str) -> list[str]:
        return read(run) if all(provenance.is_whole(run, name) for name in needed) else ["-"] * n

    return [
        f"{run.settings.source}-{run.settings.seed}",
        *_evolved(run),
        *cells(lambda run: [str(lineage_length(run))], 1, "lineage.npz"),
        *cells(_extracted, 3, "actions.npz", "sensors.npz"),
        *cells(_learned, 3, "qlearning.csv"),
        *cells(lambda run: [f"{generalisation(run, method):g}" for method in ("ER", "QL")], 2, "generalisation.csv"),
    ]


def transfer_table(some: list[Run[RunSettings]]) -> list[list[str]]:
    """Learning in new domains, a line for each measure and a column for each run that has it."""
    done = [run for run in some if provenance.is_whole(run, "transfer.csv")]
    if not done:
        return []
    lines = [["", *(f"{run.settings.source}-{run.settings.seed}" for run in done)]]
    lines.append(["---"] * len(lines[0]))
    for name in ON_TARGET:
        measure = RUN_MEASURES[name]
        values = [measure.over([measure.read(run)]).quartiles.median for run in done]
        lines.append([name.removesuffix(", target"), *(as_number(v) if np.isfinite(v) else "-" for v in values)])
    return lines


def in_short(values: list[float]) -> str:
    """Median and quartiles."""
    lower, median, upper = map(float, quartiles(np.array(values)))
    return f"{as_number(median)} ({as_number(lower)} to {as_number(upper)})"


def control_table(cells: CellsByCondition) -> list[list[str]]:
    """Conditions of one control experiment, a line each: medians and quartiles over learners."""
    measures = {
        "final performance": performance,
        "average performance": average_performance,
        "steps of an episode": steps,
        "inputs": n_inputs,
    }
    lines = [["condition", "learners", "episodes", *measures]]
    lines.append(["---"] * len(lines[0]))
    episodes = common_episodes(cells)
    for condition, some in cells.items():
        values = [in_short([measure(cell, episodes) for cell in some]) for measure in measures.values()]
        lines.append([condition, str(len(some)), str(episodes), *values])
    return lines


def test_table(tables: list[Table]) -> list[list[str]]:
    """Pairs of conditions, a line each: our test and the paper's."""
    lines = [["measure", "after", "pair", "A12 [95 %]", "p", "paper's p"]]
    lines.append(["---"] * len(lines[0]))
    for table in tables:
        for (first, second), pair in table.pairs.items():
            if min(pair.n_cells):
                low, high = pair.interval
                a12 = f"{pair.comparison.a12:.2f} [{low:.2f}, {high:.2f}]"
                printed = ", ".join(f"{value:.2g}" for value in pair.printed or ()) or "-"
                name = f"{first} - {second}"
                lines.append(
                    [table.table.title, str(table.episodes), name, a12, f"{pair.comparison.p_value:.2g}", printed]
                )
    return lines


def claims_table(some: list[Claim]) -> list[list[str]]:
    """The paper's claims, a line each."""
    lines = [["the paper says", "its numbers", "ours", "n", "verdict", "why"]]
    lines.append(["---"] * len(lines[0]))
    for claim in some:
        said = f"{claim.claim} ({claim.section})"
        lines.append([said, claim.printed, claim.ours, str(claim.n), f"**{claim.verdict.answer}**", claim.verdict.why])
    return lines


def size_table(some: list[SizeRow]) -> list[list[str]]:
    """Sizes of the study beside the paper's."""
    lines = [["size", "ours", "the paper's"], ["---"] * 3]
    for row in some:
        ours = " or ".join(f"{n:,}" for n in row.ours)
        paper = "-" if row.paper is None else f"{row.paper:,}" + ("" if row.is_printed else " (not printed)")
        lines.append([row.label, ours, paper])
    return lines


def in_markdown(lines: list[list[str]]) -> str:
    """A table as text; the first two lines are its head."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def of_task(some: list[Run[RunSettings]], cells: dict[str, CellsByCondition], answered: list[Claim]) -> dict[str, str]:
    """The tables on one task by what they are about; none of what there is nothing for.

    Args:
        some: all its runs, at least one.
        cells: finished cells of each control experiment by its name.
        answered: the paper's claims.
    """
    columns = header(some[0])
    evolved = [run for run in some if provenance.is_whole(run, "history.csv")]
    found = {"Sizes": size_table(sizes.rows(some)), "The paper's claims": claims_table(answered)}
    found["Runs"] = [columns, ["---"] * len(columns), *(row(run) for run in evolved)]
    found["Learning in new domains"] = transfer_table(some)
    for what, of_experiment in cells.items():
        if of_experiment:
            found[f"Control experiment: {what.replace('n_', 'number of ')}"] = control_table(of_experiment)
    found["Tests"] = test_table(appendix.tables(cells, some))
    return {title: in_markdown(lines) for title, lines in found.items() if len(lines) > 2}


def _evolved(run: Run[RunSettings]) -> list[str]:
    high, top, _ = goals(run)
    history = read_columns(run, "history.csv")
    times = [first_at_least(history["best"], score, history["generation"]) for score in (high, top)]
    return [*times, f"{float(history['best'][-1]):g}"]


def _extracted(run: Run[RunSettings]) -> list[str]:
    actions = read_arrays(run, "actions.npz")
    durations = np.percentile(actions["durations"], [25, 50, 75])
    n_inputs = int(read_arrays(run, "sensors.npz")["selected"].sum())
    return [f"{int(actions['n_segments']):,}", ", ".join(f"{d:g}" for d in durations), str(n_inputs)]


def _learned(run: Run[RunSettings]) -> list[str]:
    learning = read_columns(run, "qlearning.csv")
    scores = np.array(learning["score"], float)
    time = first_at_least(learning["score"], goals(run)[2], learning["episode"])
    return [f"{scores.max():g}", time, f"{score_at_the_end(scores):.2f}"]
