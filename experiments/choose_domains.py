"""How the placements of ball collecting were drawn: by rejection, from a rule that was written down beforehand.

python experiments/choose_domains.py [--arena A] [--seed 0]

prints the placements of each arena as they stand in `qboot/envs/ball_collecting/domains.py`.
"""

import argparse
import math
from collections.abc import Iterator

import jax
import numpy as np
import trivial_controllers
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from qboot.envs.ball_collecting import domains as arenas
from qboot.envs.ball_collecting import dynamics
from qboot.envs.ball_collecting.domains import Arena, Placement

MARGIN = 27.0  # units between the robot's centre and walls on a planned path: its radius and two pixels

# The rule. Lengths in units.
CLEARANCE = 60.0  # of balls and switch from walls: nobody who follows a wall runs over them
START_CLEARANCE = 45.0  # of the start from walls
BASKET_FROM_BORDER = 45.0  # the basket (radius 50) is beside a border wall
APART = 85.0  # any two things
TO_FIRST_BALL = (110.0, 220.0)  # from the start, in a straight line without walls
BEARING = (25.0, 70.0)  # degrees, of the first ball at the start: seen by one detector, not ahead
TURN = (35.0, 100.0)  # degrees, between the way to the first ball and the way on to the basket
TO_BASKET = (140.0, 320.0)  # from each ball and the switch, which the robot can go straight
AHEAD = 60.0  # no ball and no basket is so near to the line straight on from the start
TRIES = 300  # draws of each thing before all begins again
BASKETS_APART = 150.0  # of placements of one arena
RANDOM = 0.15  # balls that random controllers may bring home on average; all others none
PLANNED = 5_000  # steps in which a planner that knows the map brings all balls home


def distances(walls: np.ndarray) -> np.ndarray:
    """Distance in units of each of 200 x 200 pixels, indexed [x, y], from the nearest wall."""
    free = np.ones((200, 200), bool)
    for i0, j0, i1, j1 in walls:
        free[i0 : i1 + 1, j0 : j1 + 1] = False
    return ndimage.distance_transform_edt(free) * arenas.PIXEL


def clearance(room: np.ndarray, point: np.ndarray) -> float:
    """Distance in units of a point from the nearest wall."""
    i, j = np.clip(np.round(np.asarray(point) / arenas.PIXEL).astype(int), 0, 199)
    return room[i, j]


def is_clear(room: np.ndarray, start: np.ndarray, end: np.ndarray, margin: float = MARGIN) -> bool:
    """Whether a straight line keeps `margin` from all walls."""
    n = int(np.hypot(*(end - start)) / arenas.PIXEL) + 2
    line = np.round(np.linspace(start, end, n) / arenas.PIXEL).astype(int)
    return bool((room[line[:, 0], line[:, 1]] >= margin).all())


def shortest_path(room: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Way points (n, 2) in units from start to end, both included, that keep MARGIN from walls.

    Raises:
        ValueError: if there is no way.
    """
    if is_clear(room, start, end):
        return np.stack([start, end])
    free = room >= MARGIN
    number = np.arange(free.size).reshape(free.shape)
    rows, columns, lengths = [], [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        here = (slice(0, 200 - dx), slice(max(0, -dy), 200 - max(0, dy)))
        there = (slice(dx, 200), slice(max(0, dy), 200 - max(0, -dy)))
        both = free[here] & free[there]
        rows.append(number[here][both])
        columns.append(number[there][both])
        lengths.append(np.full(both.sum(), math.hypot(dx, dy)))
    graph = sparse.csr_matrix(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), (free.size, free.size)
    )
    first, last = (number[tuple(np.round(point / arenas.PIXEL).astype(int))] for point in (start, end))
    length, before = csgraph.dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    if not np.isfinite(length[last]):
        raise ValueError(f"no way from {start} to {end}")
    cells = [last]
    while cells[-1] != first:
        cells.append(before[cells[-1]])
    way = np.stack(np.unravel_index(cells[::-1], free.shape), axis=1) * arenas.PIXEL
    way = np.concatenate([start[None], way[1:-1], end[None]])
    # The string pulled tight: from each corner to the farthest point in a clear line.
    corners = [0]
    while corners[-1] < len(way) - 1:
        ahead = range(len(way) - 1, corners[-1], -1)
        corners.append(next(i for i in ahead if i == corners[-1] + 1 or is_clear(room, way[corners[-1]], way[i])))
    return way[corners]


def drive(posture: tuple[float, float, float], way: np.ndarray, hold: float) -> tuple[list, tuple]:
    """Commands that turn on the spot and drive along way points, and the posture then."""
    x, y, theta = posture
    commands = []
    for target in way[1:]:
        distance = math.hypot(target[0] - x, target[1] - y)
        if distance < 1e-6:
            continue
        bearing = math.atan2(target[1] - y, target[0] - x)
        turn = (bearing - theta + math.pi) % (2 * math.pi) - math.pi
        steps = math.ceil(abs(turn) / (dynamics.SPEED / arenas.RADIUS))
        for _ in range(steps):
            wheel = turn / steps * arenas.RADIUS / dynamics.SPEED / 2  # the right wheel's share of full command
            commands.append((0.5 - wheel, 0.5 + wheel, hold))
        steps = math.ceil(distance / dynamics.SPEED)
        commands += [(0.5 + distance / steps / dynamics.SPEED / 2,) * 2 + (hold,)] * steps
        x, y, theta = target[0], target[1], bearing
    return commands, (x, y, theta)


def plan(walls: np.ndarray, place: Placement) -> np.ndarray:
    """Commands (T, 3) of one who knows the map and brings all four balls home, the later two after the switch."""
    room = distances(walls)
    balls, switch, basket = (np.array(part, float) for part in (place.balls, place.switch, place.basket))
    posture, commands = tuple(place.start), []
    stops = ((balls[0], 1), (basket, 0), (balls[1], 1), (basket, 0), (switch, 1))
    stops += ((balls[2], 1), (basket, 0), (balls[3], 1), (basket, 0))
    for stop, crane in stops:
        # With an open crane unless a ball is carried home, so that no other thing is taken on the way.
        leg, posture = drive(posture, shortest_path(room, np.array(posture[:2]), stop), 1.0 - crane)
        commands += [*leg, (0.5, 0.5, float(crane))]
    return np.array(commands, np.float32)


@jax.jit
def _rewards(domain: Arena, commands: jax.Array) -> jax.Array:
    def step(state: dynamics.BallState, command: jax.Array) -> tuple[dynamics.BallState, jax.Array]:
        state = dynamics.step(domain, state, command)
        return state, state.reward

    return jax.lax.scan(step, dynamics.reset(jax.random.key(0), domain), commands)[1]


def brought_home(domain: Arena, commands: np.ndarray) -> int:
    """Balls that the first PLANNED of a sequence of commands (T, 3) bring home in the environment itself."""
    rest = np.tile(np.float32([0.5, 0.5, 0.0]), (PLANNED, 1))
    return int((np.asarray(_rewards(domain, np.concatenate([commands, rest])[:PLANNED])) > 0).sum())


def angle(vector: np.ndarray) -> float:
    """Direction of a vector in radians."""
    return math.atan2(vector[1], vector[0])


def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def domain_of(walls: np.ndarray, place: Placement) -> Arena:
    """A placement among walls (M, 4), those of the border first, as arrays."""
    return arenas.among_walls(walls[len(arenas.BORDER) :], place)


def draw(rng: np.random.Generator, room: np.ndarray) -> Placement | None:
    """A placement by the geometry of the rule, or None if one of its things found no place in TRIES draws."""
    things: list[np.ndarray] = []

    def place(least: float, fits, candidates=None) -> np.ndarray | None:
        """A point that keeps the distances and fits."""
        for _ in range(TRIES):
            point = np.round(rng.uniform(50, 550, 2) / 5) * 5 if candidates is None else candidates()
            if clearance(room, point) < least or any(np.hypot(*(point - other)) < APART for other in things):
                continue
            if fits(point):
                things.append(point)
                return point
        return None

    def at_border() -> np.ndarray:
        along, deep = np.round(rng.uniform(75, 525) / 5) * 5, BASKET_FROM_BORDER
        sides = ((along, deep), (along, arenas.SIDE - deep), (deep, along), (arenas.SIDE - deep, along))
        return np.array(sides[rng.integers(4)])

    def is_near_basket(point: np.ndarray) -> bool:
        return TO_BASKET[0] <= math.dist(point, basket) <= TO_BASKET[1] and is_clear(room, point, basket)

    def is_start(point: np.ndarray) -> bool:
        to_ball, to_basket = balls[0] - point, basket - balls[0]
        turn = math.degrees(abs(wrapped(angle(to_basket) - angle(to_ball))))
        near = TO_FIRST_BALL[0] <= np.hypot(*to_ball) <= TO_FIRST_BALL[1]
        hides = any(not is_clear(room, point, thing) for thing in things)
        return near and hides and is_clear(room, point, balls[0]) and TURN[0] <= turn <= TURN[1]

    basket = place(BASKET_FROM_BORDER - 15, lambda point: True, at_border)
    balls = [place(CLEARANCE, is_near_basket) for _ in range(4)] if basket is not None else [None]
    switch = place(CLEARANCE, is_near_basket) if balls[-1] is not None else None
    start = place(START_CLEARANCE, is_start) if switch is not None else None
    if start is None or any(ball is None for ball in balls):
        return None
    for _ in range(TRIES):
        theta = angle(balls[0] - start) + math.radians(rng.uniform(*BEARING) * rng.choice([-1, 1]))
        theta = round(wrapped(theta), 1)
        heading = np.array([math.cos(theta), math.sin(theta)])
        offsets = np.array([*balls, basket]) - start
        beside = np.abs(offsets[:, 0] * heading[1] - offsets[:, 1] * heading[0])
        if not ((offsets @ heading > 0) & (beside < AHEAD)).any():
            break
    else:
        return None

    def pair(point: np.ndarray) -> tuple[int, int]:
        return int(point[0]), int(point[1])

    return Placement((*pair(start), theta), tuple(pair(ball) for ball in balls), pair(switch), pair(basket))


def gives_away(domain: Arena) -> bool:
    """Whether a controller without skill scores: one of them a ball, or the random ones more than RANDOM on average."""
    one = arenas.stack([domain])
    for family in trivial_controllers.families():
        balls = trivial_controllers.scores(family, one)
        if balls.mean() > RANDOM if family.random else balls.max() > 0:
            return True
    return False


def choose(walls: np.ndarray, seed: int) -> Iterator[Placement]:
    """Placements that the rule lets pass, in the order in which they are drawn."""
    rng, room = np.random.default_rng(seed), distances(walls)
    chosen: list[Placement] = []
    while True:
        place = draw(rng, room)
        if place is None or any(math.dist(place.basket, other.basket) < BASKETS_APART for other in chosen):
            continue
        domain, commands = domain_of(walls, place), plan(walls, place)
        if brought_home(domain, commands) < len(place.balls) or gives_away(domain):
            continue
        chosen.append(place)
        yield place


def main() -> None:
    """Print three placements of each arena."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arena", choices=list(arenas.ARENAS), nargs="+", default=list(arenas.ARENAS))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for name in options.arena:
        walls = np.array(arenas.BORDER + arenas.ARENAS[name])
        places = choose(walls, options.seed)
        for _ in range(3):
            place = next(places)
            print(name, place, f"planned in {len(plan(walls, place))} steps", flush=True)


if __name__ == "__main__":
    main()
