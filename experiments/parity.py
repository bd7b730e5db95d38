"""Compare an environment with recorded runs of the original simulator, step by step.

Teacher-forced: every recorded state is put into the environment, which makes one step; nothing accumulates.

    python experiments/parity.py fastsim FILE.npz    # ball collecting
    python experiments/parity.py arm FILE.npz        # box pushing, MJX physics

prints one JSON object. A file that cannot be compared ends with one line on stderr and exit code 2.
"""

import argparse
import json
import sys
import zipfile
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs import geometry
from qboot.envs.ball_collecting import dynamics as ball_collecting
from qboot.envs.ball_collecting.domains import Arena
from qboot.envs.box_pushing import arm as robot
from qboot.envs.box_pushing import domains as blocks
from qboot.envs.box_pushing import dynamics as box_pushing
from qboot.envs.box_pushing import on_physics

LIGHT_COLOURS = (3, 2, 4)  # ball, basket, switch, in the recordings of fastsim
REST = 1e-4  # m, a block that shifts by less in a step is at rest


class Tests(NamedTuple):
    """Recorded tests of the arm: N tests of T steps; positions are (N, T, 3) metres."""

    width: np.ndarray  # (N,) index of the block's size, 0..2
    command: np.ndarray  # (N, T, 3) in [0, 1]
    hand: np.ndarray  # before each step
    block: np.ndarray
    next_hand: np.ndarray  # after it
    next_block: np.ndarray
    settled: np.ndarray  # (N, T) bool, the transient of the recorded reset is over
    contact: np.ndarray  # (N, T) bool, a contact has been seen, in this step or before
    success: np.ndarray  # (N, T) bool, the block has been pushed to the left


def pushes(recording: dict) -> Tests:
    """Controlled pushes: a force along one axis; `end` means a centred push along any horizontal axis."""
    n_tests, n_steps = recording["command"].shape
    command = np.full((n_tests, n_steps, 3), 0.5, np.float32)
    pushed_axis = np.where(recording["axis"] == 0, 1, 0)  # 0 = y, 1 = x
    command[np.arange(n_tests), :, pushed_axis] = recording["command"]
    usable = ~recording["flags_before"][:, :2].any(axis=1)

    def before(first: str, rest: str) -> np.ndarray:
        return np.concatenate([recording[first][:, None], recording[rest][:, :-1]], axis=1)

    tests = Tests(
        width=recording["block_length"],
        command=command,
        hand=before("hand_target", "hand"),
        block=before("block_before", "block"),
        next_hand=recording["hand"],
        next_block=recording["block"],
        settled=np.ones((n_tests, n_steps), bool),
        contact=recording["end"] | recording["premature"] | recording["touched_left"],
        success=recording["end"] & recording["touched_left"],
    )
    return Tests(*(field[usable] for field in tests))


def random_commands(recording: dict) -> Tests:
    """Random commands after a reset, which the original lets settle under neutral commands."""
    command = recording["commands"]
    flags = {name: recording[name][:, 1:] for name in ("end", "premature", "touched_left")}
    return Tests(
        width=recording["block_length"],
        command=command,
        hand=recording["hand"][:, :-1],
        block=recording["block"][:, :-1],
        next_hand=recording["hand"][:, 1:],
        next_block=recording["block"][:, 1:],
        settled=np.logical_or.accumulate((command != 0.5).any(axis=2), axis=1),
        contact=flags["end"] | flags["premature"] | flags["touched_left"],
        success=flags["end"] & flags["touched_left"],
    )


def is_thrown(tests: Tests) -> np.ndarray:
    """Tests whose block moves in the first step although no contact has been seen, (N,) bool.

    Some recorded pushes begin with the block in the air: a link of the arm hit it while the hand was placed.
    Neither its rotation nor the links are recorded, and a test of the task starts with a block at rest.
    """
    shift = np.abs(tests.next_block - tests.block)[:, 0].max(axis=1)
    return (shift > REST) & ~tests.contact[:, 0]


def domains(width: np.ndarray, n_steps: int) -> blocks.Block:
    """The block of each of the N tests, repeated for its steps: leaves (N n_steps, ...)."""
    sizes = blocks.stacked(blocks.SOURCE_WIDTHS)
    return jax.tree.map(lambda leaf: leaf[np.repeat(width, n_steps)], sizes)


@jax.jit
@jax.vmap
def advance(domain: blocks.Block, hand: jax.Array, block: jax.Array, command: jax.Array) -> box_pushing.PushState:
    """The state one step after hand (3,) and block (3,) were put in place."""
    return on_physics("mjx").step(domain, box_pushing.state_at(domain, hand, block), command)


def one_step(tests: Tests) -> box_pushing.PushState:
    """The environment's state after one step from each recorded state; leaves (N, T, ...)."""
    n_tests, n_steps = tests.contact.shape
    lanes = (field.reshape(-1, 3) for field in (tests.hand, tests.block, tests.command))
    state = advance(domains(tests.width, n_steps), *lanes)
    return jax.tree.map(lambda leaf: np.asarray(leaf).reshape(n_tests, n_steps, *leaf.shape[1:]), state)


def first_outcome(contact: np.ndarray, success: np.ndarray) -> np.ndarray:
    """Outcome of each of N tests (N, T): 0 no contact, 1 failure, 2 success, by its first contact."""
    first = contact.argmax(axis=1)[:, None]
    succeeded = np.take_along_axis(success, first, axis=1)[:, 0]
    return np.where(contact.any(axis=1), 1 + succeeded, 0)


def p95(errors: np.ndarray) -> float | None:
    """95th percentile, or None (null) without data."""
    return float(np.quantile(errors, 0.95)) if errors.size else None


def share(hits: np.ndarray) -> float | None:
    """Share of true values, or None (null) without data."""
    return float(hits.mean()) if hits.size else None


def sensor_errors(recording: dict) -> np.ndarray:
    """Absolute differences between the recorded sensors and those computed from the recorded positions."""
    hand, block = (jnp.asarray(recording[name].reshape(-1, 3)) for name in ("hand", "block"))
    sensors = recording["sensors"]
    lanes = domains(recording["block_length"], sensors.shape[1])
    return np.abs(np.asarray(jax.vmap(box_pushing.observe)(lanes, hand, block)) - sensors.reshape(-1, 13))


def arm(recording: dict) -> dict:
    """Box pushing against a recording of the robotic arm (`pushes` or `random_commands` format).

    Free steps have no contact yet, start past no stop that the command pushes against, and come after the
    transient of the recorded reset. A recorded success is a centred push (`end`) on the right face
    (`touched_left`); any other contact is a failure. Tests with a thrown block count in
    `outcome_agreement_with_thrown` only.
    """
    tests = pushes(recording) if "axis" in recording else random_commands(recording)
    state = one_step(tests)
    stopped = (np.asarray(robot.admissible(tests.hand, tests.command)) != tests.command).any(axis=2)
    thrown = is_thrown(tests)
    free = tests.settled & ~tests.contact & ~state.done & ~stopped & ~thrown[:, None]
    same = first_outcome(state.done, state.reward > 0) == first_outcome(tests.contact, tests.success)
    return {
        "free_step_error_p95": p95(np.linalg.norm(state.hand - tests.next_hand, axis=2)[free]),
        "outcome_agreement": share(same[~thrown]),
        "sensor_error_p95": p95(sensor_errors(recording)) if "sensors" in recording else None,
        "free_steps": int(free.sum()),
        "tests": len(thrown),
        "tests_thrown": int(thrown.sum()),
        "outcome_agreement_with_thrown": share(same),
    }


def fastsim(recorded: dict) -> dict:
    """Ball collecting against a recording of the fastsim robot, in any arena picture, side and radius.

    Postures count over the steps where neither side collides; sensors are those at the recorded postures.
    """
    picture = recorded["arena"]
    lights = recorded["lights_xy"]
    pixel = float(recorded["real_size"]) / picture.shape[0]
    walls = jnp.asarray(geometry.rectangles(picture))
    domain = Arena(
        walls=walls,
        inner_walls=walls,  # of a picture, nobody knows which is the border
        start=jnp.zeros(3),
        balls=jnp.asarray(lights),
        switch=jnp.zeros(2),
        basket=jnp.zeros(2),
        basket_radius=jnp.float32(0.0),
        radius=jnp.float32(recorded["radius"]),
        laser_range=jnp.float32(recorded["laser_range"]),
        pixel=jnp.float32(pixel),
        side=jnp.float32(recorded["real_size"]),
    )
    laser_angles = jnp.asarray(recorded["laser_angles"])

    def compare_step(before, wheels, after):
        old = ball_collecting.Posture(*before)
        tentative = ball_collecting.move(old, wheels[0], wheels[1], domain.radius)
        contact = ball_collecting.touch(
            domain, jnp.stack(tentative[:2]), jnp.stack([jnp.cos(tentative.theta), jnp.sin(tentative.theta)])
        )
        posture = ball_collecting.settle(old, tentative, contact)
        angles = after[2] + laser_angles
        headings = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
        distances = ball_collecting.lasers(domain, after[:2], headings)
        seen = ball_collecting.lights(domain, after[:2], headings[:2], domain.balls)
        return jnp.stack(posture), contact, distances, seen

    postures = recorded["posture"]
    before = np.concatenate([recorded["start"][:, None], postures[:, :-1]], axis=1).reshape(-1, 3)
    after = postures.reshape(-1, 3)
    wheels = recorded["wheels"].reshape(-1, 2)
    posture, contact, distances, seen = jax.device_get(jax.jit(jax.vmap(compare_step))(before, wheels, after))

    error = np.abs(posture - after)
    error[:, 2] = np.minimum(error[:, 2], 2 * np.pi - error[:, 2])
    collided = recorded["collision"].reshape(-1)
    free = ~collided & ~contact.collision

    lasers = recorded["lasers"].reshape(-1, 3)
    in_range, in_range_recorded = np.isfinite(distances), lasers >= 0
    close = np.abs(np.where(in_range, distances, 0) - lasers) <= 2 * pixel
    laser_match = np.where(in_range & in_range_recorded, close, in_range == in_range_recorded)

    # One detector pair per colour, in the order ball, basket, switch.
    colours = [np.asarray(recorded["lights_color"]) == colour for colour in LIGHT_COLOURS]
    ours = np.stack([seen[:, side, colour].any(axis=-1) for colour in colours for side in (0, 1)], axis=-1)
    bumpers = np.stack([contact.bumper_left, contact.bumper_right], axis=-1)
    bumpers_recorded = np.stack([recorded["bumper_left"], recorded["bumper_right"]], axis=-1).reshape(-1, 2)
    return {
        "steps": len(after),
        "posture_error_max": float(error[free].max(initial=0.0)),
        "collision_agreement": float((contact.collision == collided).mean()),
        "laser_within_2px": float(laser_match.mean()),
        "light_agreement": float((ours == recorded["lights"].reshape(-1, 6)).mean()),
        "bumper_agreement": float((bumpers == bumpers_recorded).mean()),
    }


COMMANDS = {"fastsim": fastsim, "arm": arm}


def load(path: str) -> dict:
    """The arrays of an .npz file by name; raises ValueError when it cannot be read."""
    if not zipfile.is_zipfile(path):
        raise ValueError("there is no .npz file of that name")
    with np.load(path) as archive:
        return dict(archive)


def main() -> None:
    """Parse the command line, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environment", choices=COMMANDS)
    parser.add_argument("file", help="recorded runs (.npz)")
    arguments = parser.parse_args()
    try:
        report = COMMANDS[arguments.environment](load(arguments.file))
    except KeyError as error:
        parser.exit(2, f"{arguments.file} is no recording for {arguments.environment}: it lacks {error}\n")
    except (OSError, zipfile.BadZipFile, ValueError, IndexError) as error:
        parser.exit(2, f"cannot use {arguments.file}: {error}\n")
    json.dump(report, sys.stdout)
    print()


if __name__ == "__main__":
    main()
