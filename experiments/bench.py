"""The benchmark suite: one JSON line per benchmark in results/bench.jsonl, and a table.

Each line has the batch size, the compile time apart from the run time, and, where there is one, the throughput of the
authors' C++ simulator on one core. Minimum of several repeats.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.episode_bench import ACTION_DURATION, calibration, episode, full_store
from qboot import qlearning
from qboot.envs import get_task
from qboot.extraction.actions import ActionSet
from qboot.extraction.baselines import chosen_sensors
from qboot.extraction.clustering import fuzzy_c_means
from qboot.extraction.sensors import SensorSettings, sensor_votes
from qboot.neuroevolution import dnn, evaluation, evolve, nsga2, variation
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.problem import Problem
from qboot.neuroevolution.settings import EvolutionSettings
from qboot.study.controls.sweep import learn_side_by_side
from qboot.study.pipeline.profiles import defaults_of

# Steps per second of the authors' simulators on one core: whole evaluation loop with a small network.
REFERENCE = {"ball_collecting": 0.25e6, "box_pushing": 0.1e6}


def timed(function: Callable, *arguments, repeats: int = 3) -> tuple[float, float]:
    """Seconds of compiling a jitted function, and the least seconds of running it."""
    started = time.perf_counter()
    compiled = function.lower(*arguments).compile()
    compile_seconds = time.perf_counter() - started
    return compile_seconds, least(lambda: jax.block_until_ready(compiled(*arguments)), repeats)


def least(call: Callable, repeats: int = 3) -> float:
    """The least seconds of a call."""
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def called(call: Callable, repeats: int = 3) -> tuple[float, float, Any]:
    """Seconds that the first call takes longer than the others, for compiling; the least seconds of the others; and
    what the first returned.
    """
    started = time.perf_counter()
    found = jax.block_until_ready(call())
    first = time.perf_counter() - started
    seconds = least(lambda: jax.block_until_ready(call()), repeats)
    return first - seconds, seconds, found


def random_genomes(n: int, network: DnnSettings) -> dnn.Genome:
    """The first generation's networks."""
    return jax.vmap(dnn.random_genome, in_axes=(0, None))(jax.random.split(jax.random.key(0), n), network)


def environment(name: str, physics: str, batch: int) -> dict:
    """Steps of the environment alone, under random commands."""
    task = get_task(name, physics)
    domain = jax.tree.map(lambda leaf: leaf[0], task.source_domains("A"))
    n_steps = min(task.max_steps, 1000)

    @jax.jit
    def run(keys):
        def step(states, t):
            commands = jax.vmap(lambda key: jax.random.uniform(jax.random.fold_in(key, t), (3,)))(keys)
            return jax.vmap(partial(task.step, domain))(states, commands), None

        return jax.lax.scan(step, jax.vmap(task.reset, in_axes=(0, None))(keys, domain), jnp.arange(n_steps))[0]

    compile_seconds, seconds = timed(run, jax.random.split(jax.random.key(0), batch))
    return {"batch": batch, "steps_per_second": batch * n_steps / seconds, "compile_s": compile_seconds}


def networks(batch: int, max_hidden: int) -> dict:
    """Steps of networks alone, one thread."""
    settings = DnnSettings(max_hidden=max_hidden)
    n_steps = 2000

    @jax.jit
    def run(genomes):
        networks = jax.vmap(dnn.express, in_axes=(0, None))(genomes, settings)

        def step(activities, _):
            return jax.vmap(dnn.step)(networks, activities, activities[:, :1] * jnp.ones(settings.n_inputs)), None

        return jax.lax.scan(step, jax.vmap(dnn.rest)(networks), None, n_steps)[0]

    compile_seconds, seconds = timed(run, random_genomes(batch, settings))
    return {"batch": batch, "steps_per_second": batch * n_steps / seconds, "compile_s": compile_seconds}


def mutation(n: int) -> dict:
    """Mutants of n networks, one thread."""
    settings = DnnSettings()
    run = jax.jit(jax.vmap(lambda key, genome: variation.mutate(key, genome, settings, variation.MutationRates())))
    compile_seconds, seconds = timed(run, jax.random.split(jax.random.key(0), n), random_genomes(n, settings))
    return {"batch": n, "s": seconds, "compile_s": compile_seconds}


def controllers(name: str, physics: str, batch: int, diversity: str = "hamming", **changes) -> dict:
    """Steps of environment, evolved network and recorder together, one thread; `changes` are to the task."""
    task = get_task(name, physics)._replace(**changes)
    network = defaults_of(task).dnn
    domains = task.source_domains("A")

    parts = task, network, DISTANCES[diversity].recorder, domains
    genomes, keys = jax.device_get(random_genomes(batch, network)), jax.random.split(jax.random.key(1), batch)
    run = partial(evaluation.evaluate_all, *parts, genomes, keys, workers=1)
    compile_seconds, seconds, found = called(run)
    steps = int(found.steps.sum())
    return {
        "batch": batch,
        "steps_per_second": steps / seconds,
        "compile_s": compile_seconds,
        "reference_steps_per_second": REFERENCE[name],
    }


def generation(name: str, physics: str, workers: int, n_before: int = 0, reevaluate: bool = False) -> dict:
    """A whole generation of the paper's size: 128 children, records, diversity, selection; median over distances.

    The population is random, or evolved for `n_before` generations in the faster physics of the task.
    """
    network = defaults_of(get_task(name)).dnn

    def problem_in(physics: str, diversities: tuple[str, ...]) -> Problem:
        task = get_task(name, physics)
        settings = EvolutionSettings(diversities=diversities, reevaluate=reevaluate)
        return Problem(task, task.source_domains("A"), settings, network, jax.random.key(0), workers)

    fast = problem_in(get_task(name).physics[-1], tuple(DISTANCES))
    begun, _ = evolve.init(fast)
    for _ in range(n_before):
        begun, _ = evolve.step(fast, begun)
    seconds = {}
    for diversity in DISTANCES:
        problem = problem_in(physics, (diversity,))
        # The survivors as this distance describes them; this compiles, too.
        state = begun._replace(behaviours=evolve.describe(problem, begun.population, begun.generation, begun.room))
        seconds[diversity] = least(lambda problem=problem, state=state: evolve.step(problem, state))
    return {"workers": workers, "median_s": float(np.median(list(seconds.values()))), **seconds}


def expert_problem(name: str) -> qlearning.Problem:
    """Q-learning on the source set with what an expert designed."""
    task = get_task(name)
    assert task.expert is not None
    actions = ActionSet(*map(jnp.asarray, task.expert.actions()))
    inputs = qlearning.input_set(chosen_sensors(task.expert.sensors, task.sensors))
    return qlearning.Problem(task, defaults_of(task).learner, task.source_domains("A"), actions, inputs)


def q_learning(name: str, n_episodes: int) -> dict:
    """Episodes of Q-learning with the human-designed actions and sensors, one thread."""
    problem = expert_problem(name)
    run = partial(qlearning.learn, qlearning.init(jax.random.key(0), problem), problem, n_episodes)
    compile_seconds, seconds, _ = called(run)
    return {"episodes": n_episodes, "s_per_episode": seconds / n_episodes, "compile_s": compile_seconds}


def sweep_of_seeds(name: str, n_seeds: int, lanes: int, n_episodes: int) -> dict:
    """Q-learners that differ in their seed: side by side in programs of `lanes`, and one after another, one thread.

    Each replays a full store from its first episode on, as learners do that have found rewards.
    `ratio` is the time of all side by side over that of all one after another; `equal` counts the seeds whose scores
    are the same in every episode; `weights` is the largest difference of a weight, over the largest weight.
    """
    problem = expert_problem(name)
    keys, length = jax.random.split(jax.random.key(0), n_seeds), problem.task.max_steps // ACTION_DURATION
    alone = [full_store(qlearning.init(key, problem), problem, length) for key in keys]
    blocks = [alone[i : i + lanes] for i in range(0, n_seeds, lanes)]

    def side_by_side():
        return [end for block in blocks for end in learn_side_by_side(block, [problem] * len(block), n_episodes)]

    def one_by_one():
        return [qlearning.learn(state, problem, n_episodes) for state in alone]

    compile_seconds, seconds, found = {}, {}, {}
    for way, call in (("vmapped", side_by_side), ("single", one_by_one)):
        compile_seconds[way], seconds[way], found[way] = called(call, 2)
    vmapped, single = (jax.tree.map(lambda *leaves: jnp.stack(leaves), *found[way]) for way in ("vmapped", "single"))
    equal = [np.array_equal(one, other) for one, other in zip(vmapped[1].score, single[1].score, strict=True)]
    pairs = zip(jax.tree.leaves(vmapped[0].networks), jax.tree.leaves(single[0].networks), strict=True)
    return {
        "seeds": n_seeds,
        "lanes": lanes,
        "episodes": n_episodes,
        "vmapped_s": seconds["vmapped"],
        "single_s": seconds["single"],
        "ratio": seconds["vmapped"] / seconds["single"],
        "equal": int(sum(equal)),
        "weights": max(float(np.abs(one - other).max() / np.abs(other).max()) for one, other in pairs),
        "compile_s": compile_seconds["vmapped"],
    }


def selection(n: int) -> dict:
    """Ranks, crowding and survivors of n individuals, two objectives."""
    select = jax.jit(nsga2.select, static_argnums=1)
    objectives = jax.random.uniform(jax.random.key(0), (n, 2))
    compile_seconds, seconds, _ = called(partial(select, objectives, n // 2), 20)
    return {"batch": n, "s": seconds, "compile_s": compile_seconds}


def clustering(n: int) -> dict:
    """Fuzzy c-means of n segments to 17 actions."""
    points = np.random.default_rng(0).normal(size=(n, 7))
    return {"points": n, "s": least(lambda: fuzzy_c_means(points, 17, 1.3, 0), 1)}


def sensors(n_traces: int) -> dict:
    """Lasso models from traces of 10,000 steps."""
    random = np.random.default_rng(0)
    traces = [np.cumsum(random.normal(size=(10_000, 13)), axis=0).astype(np.float32) for _ in range(n_traces)]
    _, seconds, _ = called(lambda: sensor_votes(iter(traces), 8, SensorSettings()))  # the first call loads scikit-learn
    return {"traces": n_traces, "s": seconds}


CORES = os.cpu_count() or 1
BENCHMARKS = {
    "machine": calibration,
    "ball_collecting environment": partial(environment, "ball_collecting", "fastsim", 32),
    **{
        f"ball_collecting controllers, {diversity}": partial(controllers, "ball_collecting", "fastsim", 16, diversity)
        for diversity in DISTANCES
    },
    **{
        f"ball_collecting controllers, batch {batch}": partial(controllers, "ball_collecting", "fastsim", batch)
        for batch in (4, 64)
    },
    "ball_collecting controllers, 1000 steps": partial(controllers, "ball_collecting", "fastsim", 16, max_steps=1000),
    **{f"networks, {hidden} hidden": partial(networks, 16, hidden) for hidden in (0, 20, 80)},
    "mutation": partial(mutation, 128),
    "ball_collecting generation": partial(generation, "ball_collecting", "fastsim", CORES),
    "box_pushing mjx environment": partial(environment, "box_pushing", "mjx", 240),
    "box_pushing mjx controllers": partial(controllers, "box_pushing", "mjx", 16),
    "box_pushing mjx generation, random": partial(generation, "box_pushing", "mjx", CORES),
    "box_pushing mjx generation, evolved": partial(generation, "box_pushing", "mjx", CORES, 60),
    "box_pushing mjx generation, evolved, survivors again": partial(
        generation, "box_pushing", "mjx", CORES, 60, reevaluate=True
    ),
    "box_pushing kinematic environment": partial(environment, "box_pushing", "kinematic", 240),
    "box_pushing kinematic generation": partial(generation, "box_pushing", "kinematic", CORES),
    "q_learning": partial(q_learning, "ball_collecting", 10),
    "ball_collecting sweep": partial(sweep_of_seeds, "ball_collecting", 30, 5, 5),
    "ball_collecting sweep, all lanes": partial(sweep_of_seeds, "ball_collecting", 30, 30, 5),
    "box_pushing sweep": partial(sweep_of_seeds, "box_pushing", 30, 5, 20),
    "box_pushing sweep, all lanes": partial(sweep_of_seeds, "box_pushing", 30, 30, 20),
    # Around the paper's size of ball collecting, and of the arm.
    "ball_collecting episode": partial(episode, "ball_collecting", 17, 40, 125),
    "ball_collecting episode, 4 actions": partial(episode, "ball_collecting", 4, 40, 125),
    "ball_collecting episode, 50 actions": partial(episode, "ball_collecting", 50, 40, 125),
    "ball_collecting episode, 10 inputs": partial(episode, "ball_collecting", 17, 10, 125),
    "ball_collecting episode, 120 inputs": partial(episode, "ball_collecting", 17, 120, 125),
    "ball_collecting episode, 35 hidden": partial(episode, "ball_collecting", 17, 40, 35),
    "ball_collecting episode, 250 hidden": partial(episode, "ball_collecting", 17, 40, 250),
    "box_pushing kinematic episode": partial(episode, "box_pushing", 7, 40, 35, "kinematic"),
    "nsga2 selection": partial(selection, 256),
    "fuzzy c-means": partial(clustering, 100_000),
    "sensor selection": partial(sensors, 50),
}


def main() -> None:
    """Run the benchmarks whose name contains the pattern."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "pattern", nargs="?", default="", help="run the benchmarks with this in their name; default all"
    )
    parser.add_argument("--out", type=Path, default=Path("results/bench.jsonl"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    machine = {
        "cores": CORES,
        "machine": platform.machine(),
        "device": jax.devices()[0].platform,
        "jax": jax.__version__,
    }
    with options.out.open("w") as stream:
        for name, benchmark in BENCHMARKS.items():
            if options.pattern in name:
                result = benchmark()
                print(json.dumps({"benchmark": name, **result, **machine}), file=stream, flush=True)
                print(f"{name:54}", "  ".join(f"{key} {_short(value)}" for key, value in result.items()), flush=True)


def _short(value: float) -> str:
    return f"{value / 1e6:.2f}M" if value >= 1e5 else f"{value:.3g}"


if __name__ == "__main__":
    main()
