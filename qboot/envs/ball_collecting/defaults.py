"""What runs of ball collecting are made with: the paper's parameters (appendix B) and sizes by profile."""

from qboot.extraction.actions import ActionSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.qlearning.settings import LearnerSettings
from qboot.study.pipeline.profiles import USUAL, Defaults, Size, controls

DEFAULTS = Defaults(
    sizes={
        "smoke": Size(1, ("A",), 16, 4, 400, 4, 6, 6, 2),
        "quick": Size(1, ("A", "B"), 128, 250, 4_000, 500, 800, 200, 25),
        "standard": Size(5, ("A", "B", "C"), 128, 600, 10_000, 500, 5_000, 2_000, 300),
        # As printed: 30 runs; ER on the target set up to the paper's median.
        "paper": Size(10, ("A", "B", "C"), 128, 1_000, 10_000, 500, 5_000, 10_000, 2_500),
    },
    controls={
        "smoke": controls(2, actions=4, sensors=4, n_actions=4),
        "quick": controls(3, actions=80, sensors=80, n_actions=80),
        "standard": controls(10, actions=2_000, sensors=2_000, n_actions=2_000),
        "paper": controls(30, actions=10_000, sensors=10_000, n_actions=5_000),
    },
    learner=LearnerSettings(gamma=0.9991, alpha=0.001, hidden=125, history="decisions"),
    dnn=DnnSettings(feed_forward=False),
    actions=ActionSettings(n_actions=17),
    n_actions=(4, 8, 17, 30, 50),  # the paper plots a range without saying which
    random_durations=(5, 25),
    # Robots of five runs lived 0.76 to 0.96 of their rollouts, in the mean over 600 generations.
    usual_costs=USUAL._replace(lived_evolving=0.9),
)


def defaults() -> Defaults:
    """All of them."""
    return DEFAULTS
