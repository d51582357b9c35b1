"""JAX: the public names of `tensionlab.interop.jax`."""

from tensionlab.interop.jax import ProvedTensions, allocate, solve, structure_matrix

__all__ = ["ProvedTensions", "allocate", "solve", "structure_matrix"]
