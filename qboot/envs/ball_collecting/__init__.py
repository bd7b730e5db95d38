"""Ball collecting (paper, section V): a mobile robot brings balls to a basket."""

from qboot.envs.ball_collecting import defaults, dynamics, expert, paper, view
from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.task import Expert, Task, View

TASK = Task(
    name="ball_collecting",
    sensors=dynamics.SENSORS,
    effectors=dynamics.EFFECTORS,
    sources=tuple(arenas.ARENAS),
    max_steps=10_000,
    rollouts_per_domain=1,
    max_score_per_domain=4,
    reward=dynamics.REWARD,
    reset=dynamics.reset,
    step=dynamics.step,
    truncated=dynamics.truncated,
    source_domains=arenas.source_domains,
    target_domains=arenas.target_domains,
    position=dynamics.position,
    outcome=dynamics.outcome,
    trajectory_period=50,
    physics=("fastsim",),
    expert=Expert(expert.actions, expert.CHOSEN_SENSORS),
    view=View(view.scene, view.all_domains, view.NOTE),
    defaults=defaults.defaults,
    paper=paper.paper,
)
