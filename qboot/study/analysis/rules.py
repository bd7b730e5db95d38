"""The rules by which a claim of a paper agrees with our numbers, differs from them, or cannot be told.

They are pure functions of numbers, stated in words in `RULES`, and were written down before the study was run, but for
one: `docs/results.md` tells which and why.
"""

from typing import NamedTuple

import numpy as np

from qboot.study.analysis.printed import Result
from qboot.study.analysis.statistics import Comparison, Quartiles

AGREES, DIFFERS, CANNOT_TELL = "agrees", "differs", "cannot be told"
MIN_RUNS = 5
SIGNIFICANCE = 0.05
# The paper's number of learners per condition: fewer can show a difference, but not that there is none.
PAPER_RUNS = 30
# Two things do not differ when their medians are nearer than this share of the top score: one ball of eight, or two
# pushes of fifteen. It is the smallest difference that one episode of ball collecting can show, and a tenth to a fifth
# of the differences that the paper itself makes something of (10 against 2 of 24, random against designed actions).
SAME_WITHIN = 1 / 8

RULES = (
    f"A number is compared when at least {MIN_RUNS} runs have it and the sizes that it depends on are at least the "
    "paper's. For what is done with evolved runs (Q-learning, new domains, control experiments), a run has evolved for "
    "long enough if it had the paper's generations or has reached the top score. A number agrees when the paper's "
    "value lies between our quartiles and, where the paper prints quartiles, our value lies between those too; "
    "otherwise it differs. A median that was never reached agrees with no number.",
    "A time to the top score is read from the curve over runs, as the paper does: the median reaches it in the first "
    "episode (or generation) in which more than half of the runs have the top score at once, so that the median "
    "itself is the top score; a quartile likewise. Single episodes count, exploration included. When the median never "
    "gets there, and the runs were given less time than the paper's took, it cannot be told.",
    f"A claim about an order needs full populations and full rollouts, at least {MIN_RUNS} runs or learners, and some "
    f"score above zero. It agrees when the Mann-Whitney test finds that order (A12 > 0.5, p < {SIGNIFICANCE}) and "
    "differs when it finds the opposite one; otherwise it differs when there are as many runs as in the paper, and "
    "cannot be told when there are fewer.",
    "A claim that two things do not differ agrees when they are shown to be equivalent (two one-sided tests at 5 %): "
    "the 90 % bootstrap interval of the difference of their medians lies within an eighth of the top score, a margin "
    "named before the study. Otherwise it differs when the Mann-Whitney test finds a difference "
    f"(p < {SIGNIFICANCE}), and cannot be told when it finds none.",
    f"A test between two conditions (appendix A) is compared when each has at least {MIN_RUNS} learners, which had at "
    "least the paper's episodes and steps, and when the evolved runs behind them have the paper's sizes or, with fewer "
    "generations, have reached the top score. It agrees when both or neither of the two p-values, the paper's and "
    f"ours, are below {SIGNIFICANCE}. Where ours is not, and a condition has fewer than the paper's {PAPER_RUNS} "
    "learners, it cannot be told.",
    "The paper prints its tests on actions for three numbers of episodes, which ours need not reach; ours are made "
    "after a third, two thirds and all of the episodes, and each is set beside the paper's three values. Where those "
    "do not lie on one side of the threshold, there is no verdict.",
    "Where a choice of our own, made after scores were seen, decides a number, that number is no evidence.",
)


class Verdict(NamedTuple):
    """An answer, and why."""

    answer: str  # AGREES, DIFFERS or CANNOT_TELL
    why: str


NO_DATA = Verdict(CANNOT_TELL, "not measured")
NO_NUMBER = Verdict(CANNOT_TELL, "the paper prints no number")
NO_PAPER = Verdict(CANNOT_TELL, "no paper tells of it")
OWN_DIFFER = Verdict(CANNOT_TELL, "the paper's own differ")


def few(n: int, needed: int = MIN_RUNS) -> Verdict:
    """The verdict on too few runs or learners."""
    return Verdict(CANNOT_TELL, f"{n} of at least {needed} needed")


def judge_number(
    result: Result | None, value: float, over_runs: Quartiles[float], n_runs: int, given: float, shortfall: str
) -> Verdict:
    """The verdict on a number.

    Args:
        result: the paper's; None without a paper.
        value: our median or mean, as the paper's; infinite for a time at which the goal was not reached.
        over_runs: our quartiles.
        n_runs: how many runs have it.
        given: of a time: how long the shortest run went on; else infinite.
        shortfall: in what our runs are smaller than the paper's; empty where they are not.
    """
    if not n_runs:
        return NO_DATA
    if result is None:
        return NO_PAPER
    if result.value is None:
        return NO_NUMBER
    if n_runs < MIN_RUNS:
        return few(n_runs)
    if shortfall:
        return Verdict(CANNOT_TELL, shortfall)
    if np.isinf(value):
        if given < result.value:
            return Verdict(CANNOT_TELL, f"not reached, and given {given:,.0f} where the paper's took more")
        return Verdict(DIFFERS, f"not reached within {given:,.0f}")
    if not over_runs.lower <= result.value <= over_runs.upper:
        return Verdict(DIFFERS, "the paper's value lies outside our quartiles")
    low = -np.inf if result.lower is None else result.lower
    high = np.inf if result.upper is None else result.upper
    if not low <= value <= high:
        return Verdict(DIFFERS, "our value lies outside the paper's quartiles")
    return Verdict(AGREES, "within the quartiles")


def judge_order(comparison: Comparison, top: float, n_runs: int, shortfall: str) -> Verdict:
    """The verdict on the claim that the first of two samples is the greater; `top` is the greatest score of any run."""
    hindrance = _hindrance(n_runs, shortfall)
    if hindrance:
        return hindrance
    if top <= 0:
        return Verdict(CANNOT_TELL, "nothing scored")
    if comparison.p_value < SIGNIFICANCE:
        if comparison.a12 > 0.5:
            return Verdict(AGREES, "the test finds this order")
        return Verdict(DIFFERS, "the test finds the opposite order")
    if n_runs < PAPER_RUNS:
        return Verdict(CANNOT_TELL, f"the test finds no order with {n_runs}, the paper had {PAPER_RUNS}")
    return Verdict(DIFFERS, "the test finds no order")


def judge_same(
    comparison: Comparison, interval: tuple[float, float], margin: float, top: float, n_runs: int, shortfall: str
) -> Verdict:
    """The verdict on the claim that two samples do not differ.

    Args:
        comparison: of the two.
        interval: 90 % interval of the difference of their medians.
        margin: of equivalence, > 0.
        top: the greatest score of any run; where nothing was learned, nothing is told apart.
        n_runs: of the smaller sample.
        shortfall: as for `judge_number`.
    """
    hindrance = _hindrance(n_runs, shortfall)
    if hindrance:
        return hindrance
    if top <= 0:
        return Verdict(CANNOT_TELL, "nothing scored")
    low, high = interval
    if -margin <= low and high <= margin:
        return Verdict(AGREES, f"equivalent: the difference lies within {margin:.3g}")
    if comparison.p_value < SIGNIFICANCE:
        return Verdict(DIFFERS, "the test finds a difference")
    return Verdict(CANNOT_TELL, f"no difference is found, and none above {margin:.3g} is excluded")


def judge_pair(p_value: float, printed: tuple[float, ...] | None, n_cells: int, shortfall: str) -> Verdict:
    """The verdict on a test of appendix A; `n_cells` of the smaller sample."""
    if not n_cells:
        return NO_DATA
    if printed is None:
        return NO_PAPER
    classes = {value < SIGNIFICANCE for value in printed}
    if len(classes) != 1:
        return OWN_DIFFER if classes else NO_NUMBER
    is_different = p_value < SIGNIFICANCE
    needed = MIN_RUNS if is_different else PAPER_RUNS
    if shortfall or n_cells < needed:
        return Verdict(CANNOT_TELL, shortfall) if shortfall else few(n_cells, needed)
    if classes == {is_different}:
        return Verdict(AGREES, "both find a difference" if is_different else "neither finds a difference")
    return Verdict(DIFFERS, "only ours finds a difference" if is_different else "only the paper's finds a difference")


def _hindrance(n_runs: int, shortfall: str) -> Verdict | None:
    if not n_runs:
        return NO_DATA
    if n_runs < MIN_RUNS:
        return few(n_runs)
    return Verdict(CANNOT_TELL, shortfall) if shortfall else None
