"""Brax's own learners (`brax.training.agents`) on the JAX that is installed."""

import jax
import jax.numpy as jnp
import numpy as np


def mend() -> None:
    """Give JAX the one function that Brax 0.14's learners call and JAX 0.10 no longer has; where it is, do nothing.

    Example:
        >>> from qboot.envs import brax_learners
        >>> brax_learners.mend()
        >>> from brax.training.agents.ppo import train
    """
    if not hasattr(jax, "device_put_replicated"):
        jax.device_put_replicated = _replicated


def _replicated(tree, devices):
    """A copy of all leaves for each device, on a leading axis, as `jax.pmap` takes them."""
    shape = (len(devices),)
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, shape + np.shape(leaf)), tree)
