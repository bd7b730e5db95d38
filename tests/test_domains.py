"""The domains of ball collecting: no gifts for controllers without skill, and all balls can be brought home."""

import sys
from pathlib import Path

import numpy as np
import pytest

from qboot.envs.ball_collecting import domains as arenas

sys.path.append(str(Path(__file__).parents[1] / "experiments"))
import choose_domains
import trivial_controllers as trivial

NINE = [(name, placement) for name in arenas.ARENAS for placement in range(3)]
# The finer grid of wheels, and cranes that have not brought a ball home anywhere, are left to the script.
FAMILIES = [
    family
    for family in trivial.families(wheels=5)
    if family.parameters[0, -1] == trivial.LET_GO_AT_BUMP and family.name != "random commands of 1 steps"
]


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_no_set_of_domains_gives_balls_away(family):
    balls = trivial.most(family, trivial.scores(family, trivial.nine_domains()))
    assert (balls <= trivial.LIMIT).all(), f"{family.name}: {balls} on sources A, B, C and targets A, B, C"


def test_a_gift_is_noticed():
    gift = arenas.Placement((100, 150, 0.0), ((280, 150), (200, 80), (450, 420), (200, 240)), (400, 60), (555, 150))
    domain = arenas.stack([choose_domains.domain_of(np.array(arenas.BORDER), gift)])
    straight_on = trivial.families()[0]
    assert trivial.scores(straight_on, domain).tolist() == [[1]]


@pytest.mark.parametrize(("name", "placement"), NINE)
def test_who_knows_the_map_brings_all_balls_home(name, placement):
    walls = np.array(arenas.BORDER + arenas.ARENAS[name])
    commands = choose_domains.plan(walls, arenas.PLACEMENTS[name][placement])
    assert choose_domains.brought_home(arenas.arena(name, placement), commands) == 4


@pytest.mark.parametrize(("name", "placement"), NINE)
def test_nothing_lies_in_a_wall_or_on_another_thing(name, placement):
    room = choose_domains.distances(np.array(arenas.BORDER + arenas.ARENAS[name]))
    place = arenas.PLACEMENTS[name][placement]
    points = np.array([place.start[:2], *place.balls, place.switch, place.basket])
    assert min(choose_domains.clearance(room, point) for point in points) > arenas.RADIUS + arenas.PIXEL
    gaps = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    assert gaps[~np.eye(len(points), dtype=bool)].min() > arenas.BASKET_RADIUS + arenas.RADIUS
