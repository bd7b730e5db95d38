"""What the paper's sections and appendix print alike about both of its tasks."""

from qboot.study.analysis.printed import SAME, Conclusion, ControlConclusion, PrintedFigure, TestTable

FASTER = "After as many episodes as Q-learning was given, its score on the target set is above that of {}"
GENERALISES = "Without further training, Q-learning scores higher on the target set than the best network"
# The paper prints its tables on actions for three numbers of episodes.
THIRDS = (1 / 3, 2 / 3, 1.0)
# The paper prints no budgets on the target set; those of the profile "paper" reach its medians.
NOT_PRINTED = ("target_episodes", "target_generations")
# Figures 17 to 19 show both tasks.
CONTROL_FIGURES = {
    "actions": PrintedFigure(
        17,
        "Median and quartiles over 30 runs. Ball collecting: extracted and human-designed actions perform alike, "
        "random ones seldom learn. Box pushing: all learn soon; extracted actions need fewer steps than "
        "human-designed ones, those fewer than random ones.",
    ),
    "sensors": PrintedFigure(
        18,
        "Without the past (instant) ball collecting is learned worst and box pushing is not harmed; the automatic "
        "selection and as many random inputs (random+) do not differ; box pushing gets half as many inputs as ball "
        "collecting.",
    ),
    "n_actions": PrintedFigure(
        19,
        "The final performance does not depend on the number of actions; with more of them, box pushing is learned "
        "slightly more slowly.",
    ),
}


def sensor_table(measure: str, *values: float | None) -> TestTable:
    """A table of section A-B: `values` of the ten pairs of conditions, row by row; None where none is printed."""
    pairs = (
        ("instant", "human"), ("instant", "selected"), ("instant", "random"), ("instant", "random+"),
        ("human", "selected"), ("human", "random"), ("human", "random+"),
        ("selected", "random"), ("selected", "random+"),
        ("random", "random+"),
    )  # fmt: skip
    printed = {pair: () if value is None else (value,) for pair, value in zip(pairs, values, strict=True)}
    return TestTable(f"Sensors: {measure}", "A-B", "sensors", measure, printed)


def on_actions(claim: str, first: str, second: str, measure: str, reservation: str = "") -> ControlConclusion:
    """A claim of section VII-A that the measure is greater with the first set of actions."""
    conclusion = Conclusion(
        claim, "VII-A, figure 17", first, second, "p < 0.001 in each of three tests", reservation=reservation
    )
    return ControlConclusion(conclusion, "actions", measure)


def same(claim: str, section: str, what: str, first: str, second: str, printed: str) -> ControlConclusion:
    """A claim that the performance does not differ in two conditions of a control experiment."""
    return ControlConclusion(Conclusion(claim, section, first, second, printed, SAME), what, "performance")


def same_with_any_number(own: int, others: tuple[int, ...]) -> tuple[ControlConclusion, ...]:
    """The claim of section VII-C, a row for each number of actions that we try against the paper's own."""
    claim = "The final performance does not depend on the number of actions: {} do as well as {}"
    return tuple(
        same(claim.format(n, own), "VII-C, figure 19", "n_actions", str(n), str(own), "a constant line in figure 19")
        for n in others
    )
