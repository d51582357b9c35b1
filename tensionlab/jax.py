"""JAX: the public names of `tensionlab.interop.jax`."""

from tensionlab.interop.jax import allocate, structure_matrix

__all__ = ["allocate", "structure_matrix"]
