"""What controllers without any skill score in the domains of ball collecting, as a table.

python experiments/trivial_controllers.py

A domain that gives balls away to such controllers cannot tell methods apart. Each controller is a plain function of
what it observes; none of them uses what it sees of balls, basket and switch. All live the full 10,000 steps. The last
row, for comparison and without a limit, is one that does: it goes where it sees what it needs next.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.ball_collecting import dynamics
from qboot.envs.ball_collecting.domains import Arena

STEPS = 10_000
LIMIT = 1  # balls that a controller without skill may bring home in a set of domains
LANES = 32  # rollouts side by side: their data stays in the cache
HOLD, LET_GO, LET_GO_AT_BUMP, LET_GO_WHEN_CARRYING, BY_COIN = range(5)
CRANES = ("always hold", "always let go", "let go at a bump", "let go when carrying", "by coin")

Command = Callable[[jax.Array, jax.Array, jax.Array, jax.Array], jax.Array]


class Family(NamedTuple):
    """Controllers that differ in parameters alone."""

    name: str
    command: Command  # (parameters (F,), observation (13,), key of the rollout, timestep ()) -> (3,) in [0, 1]
    parameters: np.ndarray  # (B, F), the crane's rule is the last
    random: bool = False  # whether the mean over the controllers counts, instead of each of them


def bumped(observation: jax.Array) -> jax.Array:
    """Whether a bumper is pressed."""
    return (observation[9] > 0) | (observation[10] > 0)


def crane(rule: jax.Array, observation: jax.Array, key: jax.Array) -> jax.Array:
    """The crane's command by one of the rules."""
    return jnp.select(
        [rule == HOLD, rule == LET_GO_AT_BUMP, rule == LET_GO_WHEN_CARRYING, rule == BY_COIN],
        [1.0, jnp.where(bumped(observation), 0.0, 1.0), 1.0 - observation[11], jax.random.uniform(key)],
        0.0,
    )


def constant(parameters: jax.Array, observation: jax.Array, key: jax.Array, timestep: jax.Array) -> jax.Array:
    """The same wheel commands for ever. Parameters: left, right, crane's rule."""
    left, right, rule = parameters
    return jnp.stack([left, right, crane(rule, observation, key)])


def turning_at_bumps(parameters: jax.Array, observation: jax.Array, key: jax.Array, timestep: jax.Array) -> jax.Array:
    """Straight on; while a bumper is pressed, a turn on the spot. Parameters: side (1 right, -1 left), crane's rule."""
    side, rule = parameters
    turn = jnp.where(bumped(observation), 0.5 * side, 0.0)
    forward = jnp.where(bumped(observation), 0.5, 1.0)
    return jnp.stack([forward + turn, forward - turn, crane(rule, observation, key)])


def wall_following(parameters: jax.Array, observation: jax.Array, key: jax.Array, timestep: jax.Array) -> jax.Array:
    """A wall is kept on one side. Parameters: side (1 right, -1 left), laser's set point, gain, crane's rule."""
    side, set_point, gain, rule = parameters
    beside = jnp.where(side > 0, observation[0], observation[1])
    ahead = observation[2]
    # Away from the wall when it is near at the side or ahead, towards it when it is far.
    away = jnp.clip(gain * jnp.maximum(beside - set_point, ahead - set_point), -0.25, 1.0)
    # A faster right wheel turns the robot to the side of the laser called right (`dynamics.move`).
    left, right = 1.0 - jnp.maximum(-side * away, 0.0), 1.0 - jnp.maximum(side * away, 0.0)
    return jnp.stack([left, right, crane(rule, observation, key)])


def wandering(parameters: jax.Array, observation: jax.Array, key: jax.Array, timestep: jax.Array) -> jax.Array:
    """Wheel commands drawn uniformly every so many steps. Parameters: seed, period, crane's rule."""
    seed, period, rule = parameters
    now = jax.random.fold_in(jax.random.fold_in(key, seed.astype(jnp.int32)), timestep // period.astype(jnp.int32))
    wheels = jax.random.uniform(now, (3,))
    coin = jnp.where(wheels[2] < 0.5, 0.0, 1.0)
    return jnp.stack([wheels[0], wheels[1], jnp.where(rule == BY_COIN, coin, crane(rule, observation, now))])


def seeking(parameters: jax.Array, observation: jax.Array, key: jax.Array, timestep: jax.Array) -> jax.Array:
    """To the basket with a ball, else to a ball, else to the switch; without memory. Not one without skill.

    Parameters: how sharply it turns to what it sees, the left wheel's command when it sees nothing, crane's rule.
    """
    sharpness, search, rule = parameters
    carrying, sees_ball = observation[11] > 0, jnp.any(observation[3:5] > 0)
    switch = observation[7:9] * (1.0 - observation[12])
    right, left = jnp.where(carrying, observation[5:7], jnp.where(sees_ball, observation[3:5], switch))
    sees = jnp.maximum(left, right)
    # A faster right wheel turns the robot to the side of the detector called right (`dynamics.move`).
    wheels = jnp.where(
        sees > 0,
        1.0 - sharpness * jnp.stack([right * (1.0 - left), left * (1.0 - right)]),
        jnp.stack([search, 1.0]),
    )
    wheels = jnp.where(bumped(observation), jnp.array([0.0, 1.0]), wheels)
    return jnp.append(wheels, crane(rule, observation, key))


SEEKER = Family("going where it sees what it needs (no limit)", seeking, np.array([[0.5, 0.3, LET_GO_AT_BUMP]]))


def table(*columns: tuple) -> np.ndarray:
    """All combinations, (B, F)."""
    return np.array(list(product(*columns)), np.float32)


def families(wheels: int = 9, seeds: int = 20) -> list[Family]:
    """All of them; `wheels` commands for each wheel."""
    grid = tuple(np.linspace(0.0, 1.0, wheels))
    after = (LET_GO_AT_BUMP, LET_GO_WHEN_CARRYING)
    sides = (1, -1)
    found = [Family("straight on", constant, table((1,), (1,), (LET_GO_AT_BUMP,)))]
    for rule in (HOLD, LET_GO, LET_GO_AT_BUMP):
        found.append(Family("constant commands", constant, table(grid, grid, (rule,))))
    for rule in after:
        found.append(Family("straight on, turning at bumps", turning_at_bumps, table(sides, (rule,))))
    for side, rule in product(sides, after):
        name = f"wall on the {'right' if side > 0 else 'left'}"
        rows = table((side,), (0.35, 0.5, 0.65, 0.8), (0.5, 1, 2, 4), (rule,))
        found.append(Family(name, wall_following, rows))
    for period, rule in product((1, 15, 50), (BY_COIN, LET_GO_AT_BUMP)):
        rows = table(tuple(range(seeds)), (period,), (rule,))
        found.append(Family(f"random commands of {period} steps", wandering, rows, True))
    return found


@partial(jax.jit, static_argnums=(0, 1))
def _rollouts(command: Command, steps: int, parameters: jax.Array, domains: Arena, keys: jax.Array) -> jax.Array:
    """Balls brought home in each of L rollouts; leading axis L on every argument."""

    def step(carry, timestep):
        states, balls = carry
        actions = jax.vmap(command, in_axes=(0, 0, 0, None))(parameters, states.observation, keys, timestep)
        states = jax.vmap(dynamics.step)(domains, states, actions)
        return (states, balls + (states.reward > 0).astype(jnp.int32)), None

    start = jax.vmap(dynamics.reset)(keys, domains), jnp.zeros(len(keys), jnp.int32)
    return jax.lax.scan(step, start, jnp.arange(steps))[0][1]


def scores(family: Family, domains: Arena, steps: int = STEPS) -> np.ndarray:
    """Balls that each controller of a family brings home in each domain, (B, D)."""
    n_domains, n = len(domains.start), len(family.parameters)
    keys = jax.random.split(jax.random.key(0), n_domains)
    balls = []
    for first in range(0, n * n_domains, LANES):
        lanes = np.arange(first, first + LANES) % (n * n_domains)  # the last block is filled up: one program for all
        places = jax.tree.map(lambda leaf, lanes=lanes: leaf[lanes % n_domains], domains)
        balls.append(
            _rollouts(family.command, steps, family.parameters[lanes // n_domains], places, keys[lanes % n_domains])
        )
    return np.concatenate(balls)[: n * n_domains].reshape(n, n_domains)


def most(family: Family, per_domain: np.ndarray) -> np.ndarray:
    """Balls (6,) of the best controller, or of the mean one if it is random, on three source and three target sets."""
    names = list(arenas.ARENAS)
    by_arena = per_domain.reshape(len(per_domain), len(names), 3)
    sources = by_arena[:, :, :2].sum(axis=2)
    targets = by_arena.sum(axis=(1, 2))[:, None] - by_arena.sum(axis=2)
    both = np.concatenate([sources, targets], axis=1)
    return both.mean(axis=0) if family.random else both.max(axis=0)


def nine_domains() -> Arena:
    """All domains, arena by arena, leading axis 9."""
    return arenas.stack([arenas.arena(name, placement) for name in arenas.ARENAS for placement in range(3)])


def main() -> int:
    """Print the table; 1 if a controller brings more than one ball home in a set."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    sets = [f"{name}, {which}" for which in ("source of 8", "target of 24") for name in arenas.ARENAS]
    print(f"| controllers | crane | how many | {' | '.join(sets)} |")
    print("|---" * (3 + len(sets)) + "|")
    fair = True
    for family in [*families(), SEEKER]:
        balls = most(family, scores(family, nine_domains()))
        fair &= family is SEEKER or bool((balls <= LIMIT).all())
        rule = CRANES[int(family.parameters[0, -1])]
        number = f"mean of {len(family.parameters)}" if family.random else f"best of {len(family.parameters)}"
        print(f"| {family.name} | {rule} | {number} | {' | '.join(f'{ball:.3g}' for ball in balls)} |", flush=True)
    return 0 if fair else 1


if __name__ == "__main__":
    sys.exit(main())
