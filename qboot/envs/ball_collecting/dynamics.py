"""The dynamics of ball collecting (paper, section V): a mobile robot brings balls to a basket.

The robot moves on two wheels by the rules of the fastsim simulator: kinematic, no sliding along walls. Two balls lie
in the arena at the start; the switch makes the other two appear. Lengths are in world units (the arena's side is
600), angles in radians; y grows downwards, so a positive angle turns clockwise on a picture, to the robot's right. As
in fastsim, that is where a right wheel that is faster than the left one turns it.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from qboot.envs import geometry
from qboot.envs.ball_collecting.domains import Arena

SENSORS = (
    "laser_front_right", "laser_front_left", "laser_front",
    "ball_right", "ball_left", "basket_right", "basket_left", "switch_right", "switch_left",
    "bumper_left", "bumper_right", "carrying_ball", "switch_pulled",
)  # fmt: skip
EFFECTORS = ("wheel_left", "wheel_right", "crane")

REWARD = 100.0  # for a ball in the basket (equation 7)
SPEED = 4.0  # wheel displacement per step at full command, in units
BALLS_AT_START = 2  # the others appear when the switch is pulled
LIGHT_HALF_OPENING = (math.pi / 2 + 0.01) / 2  # of a light detector, around +-pi/4
STILL_THRESHOLD = 1e-4  # units and radians: less is standing still
STILL_STEPS = 100  # the rollout of a robot that stands still for longer is truncated
GRID = 12  # cells per side of the discretised trajectory


class Posture(NamedTuple):
    """Where the robot is: x, y in units, theta in [-pi, pi]; each ()."""

    x: jax.Array
    y: jax.Array
    theta: jax.Array


class BallState(NamedTuple):
    """State of one rollout; the first three fields are those of every task."""

    observation: jax.Array  # (13,) in [0, 1], in the order of SENSORS
    reward: jax.Array  # () 100 when a ball just dropped into the basket (equation 7)
    done: jax.Array  # () bool, never: a rollout goes on for all of its steps
    posture: Posture
    balls: jax.Array  # (4, 2) where each ball is, or was dropped
    taken: jax.Array  # (4,) bool, picked up at some time
    carried: jax.Array  # (4,) bool, at most one
    switch_pulled: jax.Array  # () bool
    still: jax.Array  # () int32, steps without motion


class Contact(NamedTuple):
    """What the body touches at a posture; each () bool."""

    collision: jax.Array
    bumper_left: jax.Array
    bumper_right: jax.Array


def move(posture: Posture, left: jax.Array, right: jax.Array, radius: jax.Array) -> Posture:
    """Posture after the wheels rolled `left` and `right` units, on the exact arc of a circle, walls ignored."""
    half_turn = (right - left) / (4.0 * radius)  # half of the turn: the wheels are two radii apart
    # The chord of the arc points half a turn ahead; sin(h)/h by its series, |h| <= 0.1 for the robot's speed.
    chord = 0.5 * (left + right) * (1.0 - half_turn**2 / 6.0 * (1.0 - half_turn**2 / 20.0))
    direction = posture.theta + half_turn
    theta = posture.theta + 2.0 * half_turn
    theta = theta - 2.0 * jnp.pi * jnp.round(theta / (2.0 * jnp.pi))
    return Posture(posture.x + chord * jnp.cos(direction), posture.y + chord * jnp.sin(direction), theta)


def touch(domain: Arena, centre: jax.Array, heading: jax.Array) -> Contact:
    """Collision and bumpers of the body at `centre` (2,), in units, with unit `heading` (2,).

    The body overlaps every pixel within its radius of the centre's pixel, both in whole pixels. The right bumper
    feels wall pixels at bearings 0 to pi/2, the left one those at -pi/2 to 0.
    """
    pixel = jnp.round(centre / domain.pixel)
    radius = jnp.round(domain.radius / domain.pixel)
    x, y = geometry.nearest_offsets(pixel, domain.walls)
    overlap = x**2 + y**2 <= radius**2
    # A wall overlaps a quarter of the disc if its nearest point lies in the quarter, or if it reaches one of the
    # two straight sides of the quarter within the radius (the nearest point of a convex set in a convex cone).
    forward = x * heading[0] + y * heading[1]
    rightward = y * heading[0] - x * heading[1]
    side = jnp.stack([-heading[1], heading[0]])
    reach = geometry.entry_distances(pixel, jnp.stack([heading, side, -side]), domain.walls)
    ahead, at_right, at_left = reach <= radius
    right = overlap & (((forward > 0) & (rightward > 0)) | ahead | at_right)
    left = overlap & (((forward > 0) & (rightward < 0)) | ahead | at_left)
    return Contact(jnp.any(overlap), jnp.any(left), jnp.any(right))


def settle(before: Posture, tentative: Posture, contact: Contact) -> Posture:
    """Posture after a step: a collision undoes the displacement (no sliding) but not the turn."""
    return Posture(
        jnp.where(contact.collision, before.x, tentative.x),
        jnp.where(contact.collision, before.y, tentative.y),
        tentative.theta,
    )


def lasers(domain: Arena, centre: jax.Array, headings: jax.Array) -> jax.Array:
    """Distance in units from `centre` (2,) to the first wall along `headings` (N, 2); (N,), infinite out of range."""
    ends = centre + domain.laser_range * headings
    return domain.pixel * geometry.range_to_walls(centre / domain.pixel, ends / domain.pixel, domain.walls)


def lights(domain: Arena, centre: jax.Array, axes: jax.Array, points: jax.Array) -> jax.Array:
    """Whether detectors along `axes` (N, 2) see `points` (K, 2): in the opening, no wall between; (N, K) bool."""
    offset = points - centre
    along = axes[:, 0, None] * offset[:, 0] + axes[:, 1, None] * offset[:, 1]
    inside = along >= jnp.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2) * math.cos(LIGHT_HALF_OPENING)
    return inside & geometry.is_visible(centre / domain.pixel, points / domain.pixel, domain.inner_walls)


def observe(
    domain: Arena,
    posture: Posture,
    contact: Contact,
    present: jax.Array,
    carrying: jax.Array,
    pulled: jax.Array,
) -> jax.Array:
    """The 13 sensors in [0, 1], in the order of SENSORS; `present` (4,) bool tells which balls can be seen."""
    centre = jnp.stack([posture.x, posture.y])
    cosine, sine = jnp.cos(posture.theta), jnp.sin(posture.theta)
    diagonal = jnp.sqrt(0.5)
    headings = jnp.stack(
        [
            jnp.stack([cosine - sine, sine + cosine]) * diagonal,  # +pi/4, to the right
            jnp.stack([cosine + sine, sine - cosine]) * diagonal,  # -pi/4
            jnp.stack([cosine, sine]),
        ]
    )
    proximity = jnp.maximum(1.0 - lasers(domain, centre, headings) / domain.laser_range, 0.0)
    seen = lights(
        domain,
        centre,
        headings[:2],
        jnp.concatenate([domain.balls, domain.basket[None], domain.switch[None]]),
    )
    ball = jnp.any(seen[:, :4] & present, axis=1)
    flags = jnp.stack(
        [ball[0], ball[1], seen[0, 4], seen[1, 4], seen[0, 5], seen[1, 5],
         contact.bumper_left, contact.bumper_right, carrying, pulled]
    )  # fmt: skip
    return jnp.concatenate([proximity, flags.astype(jnp.float32)])


def present_balls(taken: jax.Array, switch_pulled: jax.Array) -> jax.Array:
    """Which balls lie in the arena: not taken, and of the later ones only after the switch was pulled; (4,) bool."""
    return ~taken & ((jnp.arange(taken.shape[0]) < BALLS_AT_START) | switch_pulled)


def reset(key: jax.Array, domain: Arena) -> BallState:
    """State at the start of a rollout. The task is deterministic: `key` is not used."""
    del key
    posture = Posture(domain.start[0], domain.start[1], domain.start[2])
    taken = jnp.zeros(domain.balls.shape[0], bool)
    off = jnp.array(False)
    contact = touch(domain, domain.start[:2], jnp.stack([jnp.cos(posture.theta), jnp.sin(posture.theta)]))
    return BallState(
        observation=observe(domain, posture, contact, present_balls(taken, off), off, off),
        reward=jnp.float32(0.0),
        done=off,
        posture=posture,
        balls=domain.balls,
        taken=taken,
        carried=jnp.zeros_like(taken),
        switch_pulled=off,
        still=jnp.int32(0),
    )


def step(domain: Arena, state: BallState, action: jax.Array) -> BallState:
    """One step of the simulator: `action` (3,) in [0, 1] = left wheel, right wheel, crane."""
    wheels = SPEED * (2.0 * action[:2] - 1.0)
    tentative = move(state.posture, wheels[0], wheels[1], domain.radius)
    heading = jnp.stack([jnp.cos(tentative.theta), jnp.sin(tentative.theta)])
    contact = touch(domain, jnp.stack([tentative.x, tentative.y]), heading)
    posture = settle(state.posture, tentative, contact)
    centre = jnp.stack([posture.x, posture.y])

    # Crane: holding picks up a ball or pulls the switch within one body radius, letting go drops the ball.
    def within(points: jax.Array, radius: jax.Array) -> jax.Array:
        return jnp.sum((points - centre) ** 2, axis=-1) < radius**2

    hold = action[2] >= 0.5
    carrying = jnp.any(state.carried)
    free_hands = hold & ~carrying
    reachable = present_balls(state.taken, state.switch_pulled) & within(state.balls, domain.radius)
    first = reachable & (jnp.arange(reachable.shape[0]) == jnp.argmax(reachable))
    dropped = ~hold & carrying
    scored = dropped & within(domain.basket, domain.basket_radius)
    carried = jnp.where(dropped, False, state.carried | (free_hands & first))
    taken = state.taken | carried
    switch_pulled = state.switch_pulled | (free_hands & within(domain.switch, domain.radius))

    motion = jnp.abs(jnp.stack([a - b for a, b in zip(posture, state.posture, strict=True)]))
    return BallState(
        observation=observe(
            domain, posture, contact, present_balls(taken, switch_pulled), jnp.any(carried), switch_pulled
        ),
        reward=jnp.where(scored, jnp.float32(REWARD), 0.0),
        done=state.done,
        posture=posture,
        balls=jnp.where((state.carried | carried)[:, None], centre, state.balls),
        taken=taken,
        carried=carried,
        switch_pulled=switch_pulled,
        still=jnp.where(jnp.any(motion > STILL_THRESHOLD), 0, state.still + 1),
    )


def truncated(state: BallState) -> jax.Array:
    """Whether the robot has stood still for more than 100 steps, () bool."""
    return state.still > STILL_STEPS


def position(domain: Arena, state: BallState) -> jax.Array:
    """Cell of the robot on a 12 x 12 grid over the arena, () int32 in [0, 144)."""
    column, row = (
        jnp.clip((coordinate / domain.side * GRID).astype(jnp.int32), 0, GRID - 1)
        for coordinate in (state.posture.x, state.posture.y)
    )
    return row * GRID + column


def outcome(domain: Arena, state: BallState) -> jax.Array:
    """Where the balls are in the end, (8,), as a share of the arena's side."""
    return (state.balls / domain.side).reshape(-1)
