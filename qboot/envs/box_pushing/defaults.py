"""What runs of box pushing are made with: the paper's parameters (appendix B) and sizes by profile."""

from qboot.extraction.actions import ActionSettings
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.qlearning.settings import LearnerSettings
from qboot.study.pipeline.profiles import START, Costs, Defaults, Size, controls

DEFAULTS = Defaults(
    sizes={
        "smoke": Size(1, ("A",), 16, 4, 100, 4, 6, 6, 2),
        "quick": Size(2, ("A",), 128, 40, 300, 500, 150, 100, 6),
        "standard": Size(10, ("A",), 128, 400, 300, 500, 5_000, 2_000, 300),
        # As printed: 30 runs; ER on the target set up to the episodes of the paper's median, 256 of them a generation.
        "paper": Size(30, ("A",), 128, 1_000, 300, 500, 5_000, 6_000, 1_000),
    },
    controls={
        "smoke": controls(2, actions=4, sensors=4, n_actions=4),
        "quick": controls(3, actions=100, sensors=100, n_actions=100),
        "standard": controls(10, actions=5_000, sensors=5_000, n_actions=5_000),
        "paper": controls(30, actions=5_000, sensors=5_000, n_actions=5_000),
    },
    learner=LearnerSettings(gamma=0.99, alpha=0.01, hidden=35, input_range=(-3.0, 3.0)),
    evolution=EvolutionSettings(reevaluate=True),  # it starts at random, so a score is partly luck
    dnn=DnnSettings(feed_forward=True),
    # The hand crosses its window of success in one or two steps, so the actions that matter are short.
    actions=ActionSettings(n_actions=7, min_duration=1, max_duration=20, long_segments="clip"),
    n_actions=(3, 5, 7, 15, 30),  # the paper plots a range without saying which
    random_durations=(2, 20),
    usual_costs=Costs(START, 30.0, 12.0, 2.0e-6, 7e-6, 3e-6, 8e-11, 0.7, 0.55),
)


def defaults() -> Defaults:
    """All of them."""
    return DEFAULTS
