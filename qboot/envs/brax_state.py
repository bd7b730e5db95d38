"""States of Brax environments in compiled loops: one type for all steps, keys as they keep them, what they observe."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from qboot.envs.task import Domain


def raw(key: jax.Array) -> jax.Array:
    """A key as the plain numbers that Brax's environments keep in their `info`."""
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def settled_shapes(env: Any, start: Callable, domain: Domain, name: str) -> Any:
    """Shapes and types of the environment's state after a step, which its first state must fit."""
    action = jax.ShapeDtypeStruct((env.action_size,), jnp.float32)
    first = jax.eval_shape(start, jax.random.PRNGKey(0), domain)
    after = jax.eval_shape(lambda state, action: env.step(_strong(state), action), first, action)
    structures: list[Any] = [jax.tree.structure(first), jax.tree.structure(after)]
    if structures[0] != structures[1]:
        raise ValueError(
            f"{name}: reset and step of the environment return states of different structure: metrics and info must "
            "have the same entries in both"
        )
    return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), after)


def _strong(state: Any) -> Any:
    """All leaves as arrays of a fixed type: a weak one may change from step to step."""
    return jax.tree.map(lambda leaf: jax.lax.convert_element_type(leaf, jnp.asarray(leaf).dtype), state)


def settled(state: Any, template: Any) -> Any:
    """A state with the types of the template."""
    return jax.tree.map(lambda leaf, like: jax.lax.convert_element_type(leaf, like.dtype), state, template)


def unless(over: jax.Array, new: Any, old: Any) -> Any:
    """The new state, or the old one where a rollout is over."""
    return jax.tree.map(lambda a, b: jnp.where(over, b, a), new, old)


def observed(state: Any) -> jax.Array:
    """The environment's own observation, flat."""
    obs = state.obs
    if isinstance(obs, Mapping) and "state" in obs:
        obs = obs["state"]
    return ravel_pytree(obs)[0]
