"""What the paper prints about ball collecting (section V, section VII, appendix A), over its 30 runs."""

from qboot.envs.zimmer_2016 import (
    CONTROL_FIGURES,
    FASTER,
    GENERALISES,
    NOT_PRINTED,
    THIRDS,
    on_actions,
    same,
    same_with_any_number,
    sensor_table,
)
from qboot.study.analysis.printed import Conclusion, ControlConclusion, Paper, PrintedFigure, Result, TestTable

PAPER = Paper(
    results=(
        Result("generations to the top score", "V-B1", 287, 198, 586),
        Result("best score of ER on the source set", "V-B1", 8),
        Result("lineage of the best-of-run", "V-B2", 487, statistic="mean"),
        Result("actions before clustering", "V-B2", 384_740, 246_406, 799_439),
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
    conclusions=(
        Conclusion(
            GENERALISES,
            "V-B3, figure 8",
            "generalisation of Q-learning",
            "generalisation of ER",
            "medians 10 and 2 of 24, p = 1.084e-11",
        ),
        Conclusion(
            FASTER.format("ER"),
            "V-B3, figure 9",
            "score of Q-learning, target",
            "score of ER at that time, target",
            "top score after 8,616 and 268,160 episodes in the median",
        ),
        Conclusion(
            FASTER.format("ER+transfer"),
            "V-B3, figure 9",
            "score of Q-learning, target",
            "score of ER+transfer at that time, target",
            "top score after 8,616 and 305,152 episodes in the median",
        ),
    ),
    test_tables=(
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
            THIRDS,
        ),
        sensor_table("inputs", 0.0, 8.34e-29, 8.56e-10, 8.34e-29, 1.51e-12, 2.32e-2, 1.51e-12, 0.14, None, 0.14),
        sensor_table("performance", 1.39e-5, 1.17e-6, 0.14, 6.3e-5, 2.77e-2, 4.96e-3, 0.37, 9.19e-4, 6.9e-2, 1.61e-2),
    ),
    control_conclusions=(
        on_actions("Extracted actions perform better than random ones", "extracted", "random", "performance"),
        on_actions("Human-designed actions perform better than random ones", "human", "random", "performance"),
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
        same(
            "Extracted actions perform like human-designed ones",
            "VII-A, figure 17",
            "actions",
            "extracted",
            "human",
            "similar; p = 0.2018, 0.0081, 0.0004 after different numbers of episodes",
        ),
        same(
            "The automatic selection performs like as many random inputs",
            "VII-B, figure 18",
            "sensors",
            "selected",
            "random+",
            "p = 0.069",
        ),
        *same_with_any_number(17, (4, 8, 30, 50)),
    ),
    figures={
        "segmentation": PrintedFigure(
            3,
            "200 steps of two motors, the mean of their second derivatives, the split points in green and the linear "
            "models in red.",
        ),
        "domains": PrintedFigure(
            4,
            "Three arenas with three placements of robot, balls, switch and basket each.",
        ),
        "evolved_behaviour": PrintedFigure(
            5,
            "The path of a best individual, red while it carries a ball.",
        ),
        "learning_on_source": PrintedFigure(
            6,
            "Median and quartiles over 30 runs. ER's median reaches the top score of 8 after 287 generations of 128 "
            "episodes, Q-learning's its best after 481 episodes.",
        ),
        "learned_behaviour": PrintedFigure(
            7,
            "The path of a Q-policy and, in a panel each, where its four actions are in force: turning slightly right "
            "or left, sharply left, and dropping the ball.",
        ),
        "generalisation": PrintedFigure(
            8,
            "Without further training, medians of 10 (Q-learning) and 2 (ER) of 24 over 30 runs, p = 1.084e-11.",
        ),
        "learning_on_target": PrintedFigure(
            9,
            "Median and quartiles over 30 runs. The medians reach the top score of 24 after 8,616 episodes "
            "(Q-learning), 268,160 (ER) and 305,152 (ER + transfer).",
        ),
    }
    | CONTROL_FIGURES,
    not_printed=NOT_PRINTED,
)


def paper() -> Paper:
    """All of it."""
    return PAPER
