"""Allocation as a differentiable function of JAX arrays: the one door to JAX, of the extra ``jax``."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, optional_import
from tensionlab.gradients import AllocationJacobian, allocation_jacobian
from tensionlab.solvers.base import Policy

if TYPE_CHECKING:
    import jax

__all__ = ["allocate"]


def allocate(
    structure: jax.Array,
    wrench: jax.Array,
    limits: Any,
    reference: jax.Array | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> jax.Array:
    """Return the tensions of `tensionlab.allocate`, for ``jax.grad``, ``jax.vmap`` and ``jax.jit``.

    Arguments are those of `tensionlab.allocate` with newton as the solver, as arrays of JAX; ``limits`` may be a
    pair, and ``policy`` and ``wrench_weights`` are no tracers. Each call is a callback to the processor, for the
    whole batch, also under ``jax.vmap``: in float64, whatever the type of the arrays.

    Gradients are of reverse mode, by all arrays but the weights, as `tensionlab.AllocationJacobian.pull_back` has
    them; going back chooses the tensions a second time. Errors are those of `tensionlab.allocate`, under
    ``jax.jit`` inside an error of JAX; MissingDependency if JAX is not installed.
    """
    with optional_import("jax", "tensionlab.interop.jax"):
        import jax.numpy as jnp
    lower, upper = limits if isinstance(limits, tuple) else (limits.lower, limits.upper)
    lower, upper = jnp.asarray(lower), jnp.asarray(upper)
    words = {"lower": lower, "middle": (lower + upper) / 2}
    if isinstance(reference, str) and reference not in words:
        raise InputError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
    near = words[reference] if isinstance(reference, str) else 0.0 if reference is None else reference
    matrices, *vectors = (jnp.asarray(array) for array in (structure, wrench, lower, upper, near))
    n, m = matrices.shape[-2:]
    leading = jnp.broadcast_shapes(matrices.shape[:-2], *(array.shape[:-1] for array in vectors))
    dtype = jnp.result_type(float, matrices, *vectors)
    inner = ((n, m), (n,), (m,), (m,), (m,))
    spread = [
        jnp.broadcast_to(array.astype(dtype), (*leading, *own))
        for array, own in zip((matrices, *vectors), inner, strict=True)
    ]
    weights = None if wrench_weights is None else tuple(np.asarray(wrench_weights, dtype=float).tolist())
    tensions: jax.Array = _function(policy, weights)(*spread)
    return tensions


@cache
def _function(policy: Policy | None, weights: tuple[float, ...] | None) -> Any:
    import jax

    def solved(arrays: tuple[Any, ...]) -> AllocationJacobian:
        structure, wrench, lower, upper, reference = (np.asarray(array, dtype=np.float64) for array in arrays)
        return allocation_jacobian(
            structure, wrench, (lower, upper), reference=reference, policy=policy, wrench_weights=weights
        )

    def tensions(*arrays: Any) -> Any:
        return solved(arrays).allocation.tensions.astype(arrays[0].dtype)

    def gradients(*arrays: Any) -> Any:
        *given, cotangent = arrays
        pulled_back = solved(tuple(given)).pull_back(np.asarray(cotangent, dtype=np.float64))
        return tuple(gradient.astype(cotangent.dtype) for gradient in pulled_back)

    def like(array: Any) -> Any:
        return jax.ShapeDtypeStruct(array.shape, array.dtype)

    def allocation(*arrays: Any) -> Any:
        return jax.pure_callback(tensions, like(arrays[2]), *arrays, vmap_method="broadcast_all")

    def forwards(*arrays: Any) -> Any:
        return allocation(*arrays), arrays

    def backwards(arrays: tuple[Any, ...], cotangent: Any) -> Any:
        shapes = tuple(map(like, arrays))
        return jax.pure_callback(gradients, shapes, *arrays, cotangent, vmap_method="broadcast_all")

    function = jax.custom_vjp(allocation)
    function.defvjp(forwards, backwards)
    return function
