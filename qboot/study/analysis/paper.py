"""The paper's results as data: what its text says, and where. Values it does not print are None.

The paper gives quartiles of performance: its "upper quartile" reaches a score first. Here the lower quartile is
always the smaller number, so for times it is that of the faster runs.
"""

from typing import NamedTuple


class Result(NamedTuple):
    """One number of the paper over its 30 runs."""

    measure: str  # name in `qboot.study.analysis.measures.MEASURES`
    section: str
    value: float | None
    lower: float | None = None
    upper: float | None = None
    statistic: str = "median"  # or "mean"


class Conclusion(NamedTuple):
    """The paper's claim that one measure is greater than another."""

    claim: str
    section: str
    greater: str  # names in `qboot.study.analysis.measures.MEASURES`
    smaller: str
    printed: str  # the paper's own test or numbers


RESULTS = {
    "ball_collecting": (
        Result("generations to the top score", "V-B1", 287, 198, 586),
        Result("best score of ER on the source set", "V-B1", 8),
        Result("lineage of the best-of-run", "V-B2", 487, statistic="mean"),
        Result("actions before clustering", "V-B2", 384_740, 246_406, 799_439),
        Result("actions after clustering", "V-B2", 17),
        Result("duration of an action", "V-B2", 9, 7, 18),
        Result("distinct actions", "V-B2", None),
        Result("inputs of the Q-networks", "V-B2", None),
        Result("Q-learning episodes to the top score, source", "V-B2", 481),
        Result("generalisation of ER", "V-B3", 2),
        Result("generalisation of Q-learning", "V-B3", 10),
        Result("Q-learning episodes to the top score, target", "V-B3", 8_616, 1_013),
        Result("ER episodes to the top score, target", "V-B3", 268_160, 130_304, 1_263_360),
        Result("ER+transfer episodes to the top score, target", "V-B3", 305_152, 108_160, 557_440),
    ),
    "box_pushing": (
        Result("generations to the top score", "VI-B1", 390, 333, 426),
        Result("best score of ER on the source set", "VI-B1", 15),
        Result("lineage of the best-of-run", "VI-B2", 500, statistic="mean"),
        Result("actions before clustering", "VI-B2", 27_998, 26_535, 34_634),
        Result("actions after clustering", "VII-A", 7),
        Result("duration of an action", "VI-B2", 6, 4, 18),
        Result("distinct actions", "VI-B2", None),
        Result("inputs of the Q-networks", "VI-B2", None),
        Result("Q-learning episodes to the top score, source", "VI-B2", None),
        Result("generalisation of ER", "VI-B3", None),
        Result("generalisation of Q-learning", "VI-B3", None),
        Result("Q-learning episodes to the top score, target", "VI-B3", 2_119, 1_084, 5_438),
        Result("ER episodes to the top score, target", "VI-B3", 243_328, 149_760),
        Result("ER+transfer episodes to the top score, target", "VI-B3", 10_752, 7_168, 37_888),
    ),
}

_FASTER = "After as many episodes as Q-learning was given, its score on the target set is above that of {}"

CONCLUSIONS = {
    "ball_collecting": (
        Conclusion(
            "Without further training, Q-learning scores higher on the target set than the best network",
            "V-B3, figure 8",
            "generalisation of Q-learning",
            "generalisation of ER",
            "medians 10 and 2 of 24, p = 1.084e-11",
        ),
        Conclusion(
            _FASTER.format("ER"),
            "V-B3, figure 9",
            "score of Q-learning, target",
            "score of ER at that time, target",
            "top score after 8,616 and 268,160 episodes in the median",
        ),
        Conclusion(
            _FASTER.format("ER+transfer"),
            "V-B3, figure 9",
            "score of Q-learning, target",
            "score of ER+transfer at that time, target",
            "top score after 8,616 and 305,152 episodes in the median",
        ),
    ),
    "box_pushing": (
        Conclusion(
            "Without further training, Q-learning scores higher on the target set than the best network",
            "VI-B3, figure 15",
            "generalisation of Q-learning",
            "generalisation of ER",
            "p = 0.04804 (t-test)",
        ),
        Conclusion(
            _FASTER.format("ER"),
            "VI-B3, figure 16",
            "score of Q-learning, target",
            "score of ER at that time, target",
            "top score after 2,119 and 243,328 episodes in the median",
        ),
        Conclusion(
            _FASTER.format("ER+transfer"),
            "VI-B3, figure 16",
            "score of Q-learning, target",
            "score of ER+transfer at that time, target",
            "top score after 2,119 and 10,752 episodes in the median",
        ),
    ),
}


class TestTable(NamedTuple):
    """One of the triangular tables of appendix A: p-values of Mann-Whitney tests between conditions."""

    title: str
    section: str
    what: str  # the control experiment (`qboot.study.controls.conditions`)
    measure: str  # name in `qboot.study.analysis.control_measures.MEASURES`
    printed: dict[
        tuple[str, str], tuple[float, ...]
    ]  # of two conditions; several where it is printed for several times
    shares: tuple[float, ...] = (1.0,)  # of the episodes, after which ours is tested


class ControlConclusion(NamedTuple):
    """The paper's claim that a measure is greater in one condition of a control experiment than in another."""

    conclusion: Conclusion  # greater and smaller are names of conditions
    what: str
    measure: str


# The paper prints its tables on actions for three numbers of episodes.
_THIRDS = (1 / 3, 2 / 3, 1.0)


def _sensor_table(measure: str, *values: float | None) -> TestTable:
    pairs = (
        ("instant", "human"), ("instant", "selected"), ("instant", "random"), ("instant", "random+"),
        ("human", "selected"), ("human", "random"), ("human", "random+"),
        ("selected", "random"), ("selected", "random+"),
        ("random", "random+"),
    )  # fmt: skip
    printed = {pair: () if value is None else (value,) for pair, value in zip(pairs, values, strict=True)}
    return TestTable(f"Sensors: {measure}", "A-B", "sensors", measure, printed)


TEST_TABLES = {
    "ball_collecting": (
        TestTable(
            "Actions: performance",
            "A-A",
            "actions",
            "performance",
            {
                ("random", "human"): (0.0, 0.0, 0.0),
                ("random", "extracted"): (0.0, 0.0, 0.0),
                ("human", "extracted"): (0.2018, 0.0081, 0.0004),
            },
            _THIRDS,
        ),
        _sensor_table("inputs", 0.0, 8.34e-29, 8.56e-10, 8.34e-29, 1.51e-12, 2.32e-2, 1.51e-12, 0.14, None, 0.14),
        _sensor_table("performance", 1.39e-5, 1.17e-6, 0.14, 6.3e-5, 2.77e-2, 4.96e-3, 0.37, 9.19e-4, 6.9e-2, 1.61e-2),
    ),
    "box_pushing": (
        TestTable(
            "Actions: steps of an episode",
            "A-A",
            "actions",
            "steps of an episode",
            {
                ("random", "human"): (0.0, 0.0, 0.0),
                ("random", "extracted"): (0.0, 0.0003, 0.0006),
                ("human", "extracted"): (0.0, 0.0, 0.0),
            },
            _THIRDS,
        ),
        _sensor_table("inputs", 0.0, 2.7e-13, 1.54e-10, 2.7e-13, 8.17e-5, 1.17e-7, 8.17e-5, 2.45e-5, None, 2.45e-5),
        _sensor_table("performance", 0.29, 0.35, 0.81, 0.61, 3.94e-3, 6.53e-2, 1.58e-2, 9.34e-2, 2.46e-2, 0.74),
    ),
}


def _on_actions(claim: str, greater: str, smaller: str, measure: str) -> ControlConclusion:
    return ControlConclusion(
        Conclusion(claim, "VII-A, figure 17", greater, smaller, "p < 0.001 in each of three tests"), "actions", measure
    )


CONTROL_CONCLUSIONS = {
    "ball_collecting": (
        _on_actions("Extracted actions perform better than random ones", "extracted", "random", "performance"),
        _on_actions("Human-designed actions perform better than random ones", "human", "random", "performance"),
        ControlConclusion(
            Conclusion(
                "Without past sensors (instant) the performance is lower than with those that a human chose",
                "VII-B, figure 18",
                "human",
                "instant",
                "p = 1.39e-5",
            ),
            "sensors",
            "performance",
        ),
        ControlConclusion(
            Conclusion(
                "Without past sensors (instant) the performance is lower than with the automatic selection",
                "VII-B, figure 18",
                "selected",
                "instant",
                "p = 1.17e-6",
            ),
            "sensors",
            "performance",
        ),
    ),
    "box_pushing": (
        _on_actions(
            "Human-designed actions need more steps than extracted ones", "human", "extracted", "steps of an episode"
        ),
        _on_actions(
            "Random actions need more steps than human-designed ones", "random", "human", "steps of an episode"
        ),
    ),
}
