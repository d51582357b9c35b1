"""JAX: the public names of `tensionlab.interop.jax`."""

from tensionlab.interop.jax import allocate

__all__ = ["allocate"]
