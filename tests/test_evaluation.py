"""The evaluation loop against an oracle that runs one rollout at a time, step by step."""

from functools import partial

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qboot.envs import ball_collecting, box_pushing
from qboot.neuroevolution import dnn, evaluation
from qboot.neuroevolution.distances import DISTANCES
from qboot.neuroevolution.dnn import DnnSettings
from qboot.neuroevolution.recorders import FLOW, STATES, Recorder, Timestep
from qboot.neuroevolution.variation import MutationRates, mutate
from tests.toy_tasks import CELLS, RANDOM, assert_same, corridor

PARTS = (*[distance.recorder for distance in DISTANCES.values()], FLOW, STATES)


def start_all(task):
    return tuple(part.start(task) for part in PARTS)


def update_all(task, domain, summaries, timestep):
    pairs = [part.update(task, domain, one, timestep) for part, one in zip(PARTS, summaries, strict=True)]
    return tuple(zip(*pairs, strict=True))


def finish_all(task, domain, summaries, rows, final):
    triples = zip(PARTS, summaries, rows, strict=True)
    return tuple(part.finish(task, domain, one, some, final) for part, one, some in triples)


EVERYTHING = Recorder(start_all, update_all, finish_all)


@partial(jax.jit, static_argnums=0)
def one_step(task, network, domain, state, activities, summary):
    activities = dnn.step(network, activities, state.observation)
    command = activities[: len(task.effectors)]
    summary, row = EVERYTHING.update(task, domain, summary, Timestep(state, command))
    return task.step(domain, state, command), activities, summary, row


@partial(jax.jit, static_argnums=0)
def begin(task, network, domain, key):
    return task.reset(key, domain), dnn.rest(network), EVERYTHING.start(task)


finish = jax.jit(EVERYTHING.finish, static_argnums=0)
express = jax.jit(dnn.express, static_argnums=1)


def one_rollout(task, network, domain, key):
    """Descriptor, reward and steps of a rollout."""
    state, activities, summary = begin(task, network, domain, key)
    nothing = jax.eval_shape(partial(one_step, task), network, domain, state, activities, summary)[3]
    nothing = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), nothing)
    rows, reward = [], np.float32(0)
    while len(rows) < task.max_steps and not state.done and not task.truncated(state):
        state, activities, summary, row = one_step(task, network, domain, state, activities, summary)
        rows.append(row)
        reward += np.float32(state.reward)
    steps = len(rows)
    rows = jax.tree.map(lambda *leaves: np.stack(leaves), *rows, *[nothing] * (task.max_steps - steps))
    return finish(task, domain, summary, rows, state), reward / task.reward, steps


def assert_as_one_by_one(task, network, genomes, keys, n_lanes):
    domains = task.source_domains("A")
    found = evaluation.evaluate(task._replace(lanes=n_lanes), network, EVERYTHING, domains, genomes, keys)
    rollouts, n_rollouts = evaluation.rollouts_of(task, domains)
    found, genomes, rollouts = jax.device_get((found, genomes, rollouts))
    for i in range(len(keys)):
        expressed = express(jax.tree.map(lambda leaf, i=i: leaf[i], genomes), network)
        for j in range(n_rollouts):
            domain = jax.tree.map(lambda leaf, j=j: leaf[j], rollouts)
            expected = one_rollout(task, expressed, domain, jax.random.fold_in(keys[i], j))
            kept = jax.tree.map(lambda leaf, i=i, j=j: leaf[i, j], found)
            # Another program rounds the last bit of a network's outputs differently.
            assert_same(
                jax.tree.leaves((kept.descriptors, kept.scores, kept.steps)), jax.tree.leaves(expected), rtol=1e-5
            )


first_genomes = jax.jit(jax.vmap(dnn.random_genome, in_axes=(0, None)), static_argnums=1)


def random_genomes(n, network):
    return first_genomes(jax.random.split(jax.random.key(3), n), network)


# One goal is far, one near, from a random start: rollouts of all lengths, 43 being no multiple of a chunk.
CORRIDOR = corridor((0, RANDOM), (1, 2), max_steps=43, rollouts_per_domain=2)
CORRIDOR_NETWORK = DnnSettings(n_inputs=CELLS + 1, n_outputs=1, max_hidden=2, max_connections=12)


@given(st.integers(1, 7), st.integers(1, 9))
@settings(max_examples=4, deadline=None)
def test_any_number_of_rollouts_in_any_number_of_lanes(n_controllers, n_lanes):
    keys = jax.random.split(jax.random.key(n_controllers), n_controllers)
    assert_as_one_by_one(CORRIDOR, CORRIDOR_NETWORK, random_genomes(n_controllers, CORRIDOR_NETWORK), keys, n_lanes)


def test_arrays_of_odd_shapes_are_refused():
    keys, genomes = jax.random.split(jax.random.key(0), 3), random_genomes(3, CORRIDOR_NETWORK)
    domains = CORRIDOR.source_domains("A")

    def evaluate(genomes=genomes, keys=keys, domains=domains):
        return evaluation.evaluate(CORRIDOR, CORRIDOR_NETWORK, FLOW, domains, genomes, keys)

    for odd in (
        {"keys": keys[:2]},
        {"keys": keys[0]},
        {"genomes": genomes._replace(weights=genomes.weights[:2])},
        {"genomes": genomes._replace(weights=genomes.weights[:, :-1])},
        {"domains": (domains, domains[:1])},
    ):
        with pytest.raises(AssertionError):
            evaluate(**odd)


GROWING = MutationRates(0.3, 0.3, 0.3, 0.6, 0.05, 0.2)
ROBOTS = {
    "ball_collecting": ball_collecting.TASK._replace(max_steps=300),
    "box_pushing": box_pushing.on_physics("kinematic")._replace(max_steps=300),
    "corridor": corridor((5, 1), (2, 4)),
}


def chosen_by(mask, new, old):
    return np.where(evaluation.expand(mask, new), new, old)


def networks_of_all_sizes(settings):
    """16 networks of 0 to 15 rounds of growth."""
    grow = jax.jit(jax.vmap(partial(mutate, settings=settings, rates=GROWING)))
    genomes = first_genomes(jax.random.split(jax.random.key(0), 16), settings)
    for i in range(15):
        mutants, _ = grow(jax.random.split(jax.random.key(i + 1), 16), genomes)
        grows = np.arange(16) > i
        genomes = jax.tree.map(partial(chosen_by, grows), mutants, genomes)
    return jax.device_get(genomes)


@pytest.mark.parametrize(
    "name", ["corridor", *(pytest.param(name, marks=pytest.mark.slow) for name in ROBOTS if name != "corridor")]
)
def test_room_for_hidden_neurons_changes_rounding_alone(name):
    task = ROBOTS[name]
    settings = DnnSettings(n_inputs=len(task.sensors), n_outputs=len(task.effectors))
    genomes, keys = networks_of_all_sizes(settings), jax.random.split(jax.random.key(7), 16)
    last = np.flatnonzero(genomes.hidden.any(axis=0))[-1]
    rooms = [dnn.least_room(jax.tree.map(lambda leaf, n=n: leaf[:n], genomes), settings) for n in range(1, 17)]
    assert rooms == sorted(rooms) and rooms[0] == 4 and rooms[-1] > last
    parts = task, settings, FLOW, task.source_domains("A"), genomes, keys
    least, all_room = evaluation.evaluate_all(*parts, workers=1), evaluation.evaluate_all(*parts, workers=1, room=20)
    assert_same(evaluation.evaluate_all(*parts, workers=2, room=rooms[-1]), least)
    begun, other = (jax.tree.map(lambda leaf: leaf[..., :100, :], each.descriptors) for each in (least, all_room))
    assert_same(begun, other, atol=1e-3)
