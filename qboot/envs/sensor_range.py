"""The range of a Brax environment's sensors, as random rollouts show it."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qboot.envs.brax_state import observed, raw, settled, settled_shapes, unless

# Sensors whose range nobody gave are watched in so many random rollouts of so many steps at most.
WATCHED_ROLLOUTS = 32
WATCHED_STEPS = 200
WATCHED_SEED = 0
MARGIN = 0.1  # of the range seen, on both sides: a trained robot goes further than a random one


def estimated_range(
    env: Any,
    observe: Callable[[Any], jax.Array] | None = None,
    action_range: tuple[Any, Any] = (-1.0, 1.0),
    reset: Callable[[jax.Array], Any] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value (S,) of each sensor in random rollouts, widened by a tenth and rounded outwards.

    32 rollouts of 200 steps, or until done, with uniform actions, always from the same seed. The ends are rounded to
    two digits of the range, so that other hardware finds the same. A sensor that never varied gets a range around its
    value.

    Args:
        env: as for `from_brax`.
        observe: as for `from_brax`.
        action_range: as for `from_brax`.
        reset: key -> the environment's state; default `env.reset`.
    """
    watch = observe or observed
    begin = reset or env.reset
    low, high = checked_range("estimated_range", "action_range", action_range)
    template = settled_shapes(env, lambda key, _: begin(key), None, "estimated_range")

    def rollout(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        def step(carry: tuple, key: jax.Array) -> tuple[tuple, None]:
            state, lowest, highest = carry
            action = low + jax.random.uniform(key, (env.action_size,)) * (high - low)
            after = settled(env.step(jax.tree.map(lambda leaf: leaf, state), action), template)
            after = unless(state.done > 0, after, state)
            seen = watch(after)
            return (after, jnp.minimum(lowest, seen), jnp.maximum(highest, seen)), None

        state = settled(begin(raw(key)), template)
        carry = state, watch(state), watch(state)
        (_, lowest, highest), _ = jax.lax.scan(step, carry, jax.random.split(key, WATCHED_STEPS))
        return lowest, highest

    keys = jax.random.split(jax.random.key(WATCHED_SEED), WATCHED_ROLLOUTS)
    lowest, highest = jax.device_get(jax.jit(jax.vmap(rollout))(keys))
    return _rounded_outwards(lowest.min(axis=0), highest.max(axis=0))


def checked_range(name: str, kind: str, given: tuple[Any, Any]) -> tuple[np.ndarray, np.ndarray]:
    """A range as two arrays.

    Raises:
        ValueError: if it is not finite, or low is not below high; `name` and `kind` say whose.
    """
    low, high = (np.asarray(end, np.float32) for end in given)
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
        raise ValueError(f"{name}: {kind} must be (low, high), finite, low below high, got {given}")
    return low, high


def _rounded_outwards(lowest: np.ndarray, highest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    width = (highest - lowest).astype(float)
    still = width <= 1e-6 * np.maximum(1.0, np.abs(lowest))
    width = np.where(still, 2.0 * np.maximum(1.0, np.abs(lowest)), width)
    centre = (lowest + highest) / 2.0
    unit = 10.0 ** (np.floor(np.log10(width)) - 1)
    half = (0.5 + MARGIN) * width
    low, high = np.floor((centre - half) / unit) * unit, np.ceil((centre + half) / unit) * unit
    digits = [max(0, 1 - math.floor(math.log10(one))) for one in width]
    rounded = [[round(float(value), n) for value, n in zip(end, digits, strict=True)] for end in (low, high)]
    return np.array(rounded[0], np.float32), np.array(rounded[1], np.float32)
