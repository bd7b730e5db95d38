"""What the paper prints about box pushing (section VI, section VII, appendix A), over its 30 runs."""

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
from qboot.study.analysis.printed import Conclusion, Paper, PrintedFigure, Result, TestTable

# The moves of `expert.actions` go 4 cm since faster ones scored lower; how many steps they take is ours, not found.
OWN_MOVES = "the length of a human-designed move is ours, chosen after scores were seen"

PAPER = Paper(
    results=(
        Result("generations to the top score", "VI-B1", 390, 333, 426),
        Result("best score of ER on the source set", "VI-B1", 15),
        Result("lineage of the best-of-run", "VI-B2", 500, statistic="mean"),
        Result("actions before clustering", "VI-B2", 27_998, 26_535, 34_634),
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
    conclusions=(
        Conclusion(
            GENERALISES,
            "VI-B3, figure 15",
            "generalisation of Q-learning",
            "generalisation of ER",
            "p = 0.04804 (t-test)",
        ),
        Conclusion(
            FASTER.format("ER"),
            "VI-B3, figure 16",
            "score of Q-learning, target",
            "score of ER at that time, target",
            "top score after 2,119 and 243,328 episodes in the median",
        ),
        Conclusion(
            FASTER.format("ER+transfer"),
            "VI-B3, figure 16",
            "score of Q-learning, target",
            "score of ER+transfer at that time, target",
            "top score after 2,119 and 10,752 episodes in the median",
        ),
    ),
    test_tables=(
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
            THIRDS,
            reservations={"human": OWN_MOVES},
        ),
        sensor_table("inputs", 0.0, 2.7e-13, 1.54e-10, 2.7e-13, 8.17e-5, 1.17e-7, 8.17e-5, 2.45e-5, None, 2.45e-5),
        sensor_table("performance", 0.29, 0.35, 0.81, 0.61, 3.94e-3, 6.53e-2, 1.58e-2, 9.34e-2, 2.46e-2, 0.74),
    ),
    control_conclusions=(
        on_actions(
            "Human-designed actions need more steps than extracted ones",
            "human",
            "extracted",
            "steps of an episode",
            OWN_MOVES,
        ),
        on_actions(
            "Random actions need more steps than human-designed ones",
            "random",
            "human",
            "steps of an episode",
            OWN_MOVES,
        ),
        on_actions("Random actions need more steps than extracted ones", "random", "extracted", "steps of an episode"),
        same(
            "Without past sensors (instant) the performance is that with those that a human chose",
            "VII-B, figure 18",
            "sensors",
            "instant",
            "human",
            "p = 0.29",
        ),
        same(
            "The automatic selection performs like as many random inputs",
            "VII-B, figure 18",
            "sensors",
            "selected",
            "random+",
            '"no significant difference", though its table has p = 0.0246',
        ),
        *same_with_any_number(7, (3, 5, 15, 30)),
    ),
    figures={
        "environment": PrintedFigure(
            10,
            "A picture of the simulated arm above a table with a box, which it must push by hitting it from the side.",
        ),
        "domains": PrintedFigure(
            11,
            "Three source blocks in the top row, three target blocks of other sizes below.",
        ),
        "evolved_behaviour": PrintedFigure(
            12,
            "The path of the end effector from its start to the block.",
        ),
        "learned_behaviour": PrintedFigure(
            13,
            "The path of the end effector with three actions: one puts the arm high and into a corner, one turns and "
            "descends, one goes straight to the block.",
        ),
        "learning_on_source": PrintedFigure(
            14,
            "Median and quartiles over 30 runs. ER's median reaches the top score of 15 after 390 generations of 128 "
            "episodes.",
        ),
        "generalisation": PrintedFigure(
            15,
            "Q-learning scores higher than ER without further training, p = 0.04804 (t-test).",
        ),
        "learning_on_target": PrintedFigure(
            16,
            "Median and quartiles over 30 runs. The medians reach the top score of 15 after 2,119 episodes "
            "(Q-learning), 243,328 (ER) and 10,752 (ER + transfer).",
        ),
    }
    | CONTROL_FIGURES,
    not_printed=NOT_PRINTED,
)


def paper() -> Paper:
    """All of it."""
    return PAPER
