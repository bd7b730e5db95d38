"""What loops need to know of the instances that `vmap` runs side by side."""

import jax
import jax.numpy as jnp


@jax.custom_batching.custom_vmap
def any_in_batch(flag: jax.Array) -> jax.Array:
    """`flag`, () bool; under `vmap`, whether it is true in any batched instance.

    A `while_loop` whose condition differs between instances copies its whole carry, all the networks
    included, at every iteration. With this condition it does not, and its body masks what must not change.
    """
    return flag


@any_in_batch.def_vmap
def _(axis_size: int, in_batched: list[bool], flag: jax.Array) -> tuple[jax.Array, bool]:
    return jnp.any(flag), False
