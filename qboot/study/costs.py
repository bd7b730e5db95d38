"""What the jobs of a study cost: some rates of a machine, times the sizes of the profile.

Rates are in core-seconds, so that it does not matter how many cores there are, nor much what else they are busy with.
Evolution costs the same for every step of every rollout, whoever is in it. Q-learning costs so much for a step of the
robot, and so much for each update, after a decision or in the replay, by the size of the networks.
"""

import math
from collections.abc import Sequence

import numpy as np

from qboot.envs.registry import get_task
from qboot.envs.task import Task
from qboot.extraction.actions import ActionSettings
from qboot.study.controls.conditions import LAGS, Place, places
from qboot.study.controls.shapes import INPUTS_AT_A_TIME, costs_little, largest, padded
from qboot.study.jobs import Job
from qboot.study.pipeline.episode import Episode, n_rollouts
from qboot.study.pipeline.profiles import Costs, Defaults, control_size_of, defaults_of, size_of
from qboot.study.store.settings import RunSettings

# What only an extraction tells, about as in the runs of docs/results.md: ancestors of the best-of-run for each
# generation, the share of all inputs that the automatic selection keeps, and how far from the shortest to the longest
# duration that is allowed those of the actions lie that a policy chooses.
ANCESTORS_PER_GENERATION = 0.25
SHARE_OF_INPUTS = 0.8
SHARE_OF_DURATIONS = 1 / 8
# A generation, in evaluations of its children: with what diversity and selection take (docs/performance.md).
GENERATION = 1.1
# To play a step of the lineage again, cut it into segments and correlate it, in steps of evolution.
EXTRACTION = 20.0


def seconds_of(job: Job, costs: Costs) -> dict[str, float]:
    """Core-seconds of a job from its beginning to its end, by the names of the parts that it reports to be at."""
    return _of_stage(job.run, job.step, costs) if job.run else _of_control(job, costs)


def of_usual(job: Job) -> dict[str, float]:
    """The same by usual costs, unmeasured: the weights of the progress bar."""
    return seconds_of(job, defaults_of(get_task(job.task)).usual_costs)


def n_selected(task: Task, defaults: Defaults) -> float:
    """The number of inputs to expect from the automatic selection."""
    return SHARE_OF_INPUTS * defaults.sensors.lags * len(task.sensors)


def extracted_duration(settings: ActionSettings) -> float:
    """Steps of an extracted action to expect, in the mean over decisions."""
    return settings.min_duration + SHARE_OF_DURATIONS * (settings.max_duration - settings.min_duration)


def _of_stage(run: RunSettings, step: str, costs: Costs) -> dict[str, float]:
    task, defaults = get_task(run.task, run.physics), defaults_of(get_task(run.task))
    evolution = run.evolution
    source = n_rollouts(task, task.source_domains(run.source))
    target = n_rollouts(task, task.target_domains(run.source))

    def generations(n: float, n_rollouts: int) -> float:
        episodes = evolution.population * (2 + n * (2 if evolution.reevaluate else 1))
        programs = min(len(evolution.diversities), 1 + n // evolution.diversity_period)
        steps = episodes * n_rollouts * run.n_steps * costs.lived_evolving
        return programs * costs.compile_evolution + steps * costs.rollout_step * GENERATION

    def episodes(n: int, n_rollouts: int) -> float:
        sizes = run.actions.n_actions, n_selected(task, defaults), extracted_duration(run.actions)
        learning = Episode(run.learner, task.rollouts_per_domain, n_rollouts, run.n_steps, *sizes)
        return costs.compile_learning + n * learning.seconds(costs)

    if step == "evolve":
        return {step: costs.start + generations(evolution.generations, source)}
    if step == "extract":
        ancestors = min(evolution.horizon, max(2.0, ANCESTORS_PER_GENERATION * evolution.generations))
        steps = ancestors * source * run.n_steps * costs.lived_evolving
        return {step: costs.start + costs.compile_evolution + steps * costs.rollout_step * EXTRACTION}
    if step == "learn":
        return {step: costs.start + episodes(run.episodes, source)}
    without_learning = costs.compile_evolution + costs.compile_learning
    return {
        "target_learn": costs.start + without_learning + episodes(run.target_episodes, target),
        "target_er": generations(until_top(run, "ER"), target),
        "target_er_transfer": generations(until_top(run, "ER+transfer"), target),
    }


def until_top(run: RunSettings, method: str) -> float:
    """Generations on the target set to expect of "ER" or "ER+transfer", which end with the top score where that stays.

    By the quartiles over the paper's runs, at most: each quarter of the runs takes as long as its slowest.
    """
    limit, task = run.target_generations, get_task(run.task)
    results = task.paper().results if task.paper and run.evolution.keeps_best else ()
    printed = {result.measure: result for result in results}.get(f"{method} episodes to the top score, target")
    if printed is None or None in (printed.lower, printed.value, printed.upper):
        return limit
    population = run.evolution.population
    quarters = [max(0.0, episodes / population - 2) for episodes in (printed.lower, printed.value, printed.upper)]
    return sum(min(limit, generation) for generation in (*quarters, math.inf)) / 4


def _of_control(job: Job, costs: Costs) -> dict[str, float]:
    """All learners of an experiment, a program for each shape."""
    task = get_task(job.task)
    size = control_size_of(task, job.what, job.profile)
    defaults = defaults_of(task)
    shared = largest(task, defaults.actions, defaults.learner, size_of(task, job.profile).n_steps)
    programs, is_shared = 0, False
    # The extraction of other numbers of actions plays the traces again.
    seconds = costs.start + (costs.compile_evolution if job.what == "n_actions" else 0.0)
    for condition, place in places(task, job.what).items():
        if place.what == job.what:
            episode = _control_learning(job, condition)
            if costs_little(task, episode, size.episodes, shared):
                episode, is_shared = padded(episode, shared), True
            else:
                is_of_any_size = place == Place("sensors", "random")
                programs += min(size.runs, LAGS * len(task.sensors) // INPUTS_AT_A_TIME) if is_of_any_size else 1
            seconds += size.runs * size.episodes * episode.seconds(costs)
    return {job.step: seconds + (programs + is_shared) * costs.compile_learning}


def _control_learning(job: Job, condition: str) -> Episode:
    """An episode of a condition, with as many actions and inputs as are to be expected."""
    task = get_task(job.task)
    defaults, expert, n_sensors = defaults_of(task), task.expert, len(task.sensors)
    extracted = {
        str(n): (n, [extracted_duration(defaults.actions)]) for n in (*defaults.n_actions, defaults.actions.n_actions)
    }
    own = extracted[str(defaults.actions.n_actions)]
    of_actions: dict[str, tuple[int, Sequence[float]]] = extracted | {
        "extracted": own,
        "random": (own[0], defaults.random_durations),
        "human": (len(expert.actions().durations), expert.actions().durations) if expert else own,
    }
    selected = n_selected(task, defaults)
    of_inputs = {
        "instant": n_sensors,
        "human": sum(map(len, expert.sensors)) if expert else selected,
        "selected": selected,
        "random": LAGS * n_sensors / 2,  # any number up to that, all equally likely
        "random+": selected,
    }
    # All of an experiment differs in one thing; the other is what a human designed.
    n_actions, durations = of_actions["human" if job.what == "sensors" else condition]
    return Episode(
        settings=defaults.learner,
        rollouts_per_domain=task.rollouts_per_domain,
        n_rollouts=n_rollouts(task, task.source_domains(task.sources[0])),
        n_steps=size_of(task, job.profile).n_steps,
        n_actions=n_actions,
        n_inputs=of_inputs[condition if job.what == "sensors" else "human"],
        duration=float(np.mean(durations)),
    )
