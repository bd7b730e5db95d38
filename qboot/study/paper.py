"""The paper's results as data: what its text says, and where. Values it does not print are None.

The paper gives quartiles of performance: its "upper quartile" reaches a score first. Here the lower quartile is
always the smaller number, so for times it is that of the faster runs.
"""

from typing import NamedTuple


class Result(NamedTuple):
    """One number of the paper over its 30 runs."""

    measure: str  # name in `qboot.study.measures.MEASURES`
    section: str
    value: float | None
    lower: float | None = None
    upper: float | None = None
    statistic: str = "median"  # or "mean"


class Conclusion(NamedTuple):
    """The paper's claim that one measure is greater than another."""

    claim: str
    section: str
    greater: str  # names in `qboot.study.measures.MEASURES`
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
