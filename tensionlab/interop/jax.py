"""Allocation and structure matrix as differentiable functions of JAX arrays: the one door to JAX."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, optional_import
from tensionlab.gradients import AllocationJacobian, allocation_jacobian
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Policy

if TYPE_CHECKING:
    import jax

__all__ = ["allocate", "structure_matrix"]


def structure_matrix(
    rig: Rig,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    anchors: ArrayLike | None = None,
    attachments: ArrayLike | None = None,
) -> jax.Array:
    """Return the structure matrices (..., n, m) of `Rig.structure_matrix` in operations of JAX.

    Derivatives of both modes are by position (..., d), rotation (..., 3, 3), in the plane an angle (...), and, if
    given in place of the rig's, anchors and attachments (..., m, d), in m. InputError for a rig with pulleys that
    swivel, or with anchors on body frames.
    """
    with optional_import("jax", "tensionlab.interop.jax"):
        import jax.numpy as jnp
    if rig.pulleys is not None or rig.frames:
        raise InputError(f'rig "{rig.name}": pulleys and body frames are not for JAX; use rig.structure_matrix')
    vectors = jnp.asarray(rig.anchors if anchors is None else anchors) - jnp.asarray(position)[..., None, :]
    arms = None
    if rig.platform is not None:
        arms = jnp.asarray(rig.attachments if attachments is None else attachments)
        if rotation is not None:
            turn = jnp.asarray(rotation)
            if rig.dimension == 2:
                c, s = jnp.cos(turn), jnp.sin(turn)
                turn = jnp.stack([jnp.stack([c, -s], axis=-1), jnp.stack([s, c], axis=-1)], axis=-2)
            arms = arms @ jnp.swapaxes(turn, -1, -2)
        vectors = vectors - arms
    directions = vectors / jnp.linalg.norm(vectors, axis=-1, keepdims=True)
    if arms is not None:
        torques = jnp.cross(arms, directions)
        directions = jnp.concatenate([directions, torques.reshape(*directions.shape[:-1], -1)], axis=-1)
    return jnp.swapaxes(directions, -1, -2)


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

    Derivatives are of both modes, by all arrays but the weights, and those of `tensionlab.AllocationJacobian`. Of
    feasible wrenches there are second derivatives too (``jax.hessian``); beyond, the first count as constant.
    Errors are those of `tensionlab.allocate`, under ``jax.jit`` inside an error of JAX; MissingDependency if JAX
    is not installed.
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
    tensions: jax.Array = _function(policy, weights)(*spread)[0]
    return tensions


@cache
def _function(policy: Policy | None, weights: tuple[float, ...] | None) -> Any:
    """Return a function of five arrays with equal leading axes: the tensions, and whether they are exact."""
    import jax
    import jax.numpy as jnp

    def solved(arrays: tuple[Any, ...]) -> AllocationJacobian:
        structure, wrench, lower, upper, reference = (np.asarray(array, dtype=np.float64) for array in arrays)
        return allocation_jacobian(
            structure, wrench, (lower, upper), reference=reference, policy=policy, wrench_weights=weights
        )

    def tensions(*arrays: Any) -> Any:
        found = solved(arrays).allocation
        return found.tensions.astype(arrays[0].dtype), np.asarray(found.exact)

    def beyond(exact: Any, *arrays: Any) -> Any:
        """Return the derivatives of all tensions by all arrays; zeros where the answer is exact."""
        infeasible, lead = ~np.asarray(exact), arrays[1].ndim - 1
        if not infeasible.any():
            return tuple(np.zeros(each.shape, each.dtype) for each in _derivatives_by(arrays))
        found = solved(arrays)
        rows = [found.pull_back(unit) for unit in np.eye(arrays[2].shape[-1])]
        stacked = (np.stack(each, axis=lead) for each in zip(*rows, strict=True))
        return tuple(
            np.where(np.expand_dims(infeasible, tuple(range(lead, each.ndim))), each, 0.0).astype(arrays[0].dtype)
            for each in stacked
        )

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def allocation(*arrays: Any) -> Any:
        like = [jax.ShapeDtypeStruct(arrays[2].shape, arrays[2].dtype)]
        like.append(jax.ShapeDtypeStruct(arrays[1].shape[:-1], np.bool_))
        return jax.pure_callback(tensions, tuple(like), *arrays, vmap_method="broadcast_all")

    @allocation.defjvp  # type: ignore[untyped-decorator]
    def changes(arrays: Any, tangents: Any) -> Any:
        chosen, exact = allocation(*arrays)
        inside = _change_while_exact(chosen, arrays, tangents)
        given, constant = _derivatives_by(arrays), jax.lax.stop_gradient((exact, *arrays))
        by_array = jax.pure_callback(beyond, given, *constant, vmap_method="broadcast_all")
        outside = jnp.einsum("...inm,...nm->...i", by_array[0], tangents[0])
        for each, tangent in zip(by_array[1:], tangents[1:], strict=True):
            outside += jnp.einsum("...ik,...k->...i", each, tangent)
        change = jnp.where(exact[..., None], inside, outside)
        return (chosen, exact), (change, np.zeros(exact.shape, jax.dtypes.float0))

    return allocation


def _derivatives_by(arrays: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the shapes and types of the derivatives of tensions by each of five arrays."""
    import jax

    leading, m = arrays[1].shape[:-1], arrays[2].shape[-1]
    return tuple(
        jax.ShapeDtypeStruct((*leading, m, *array.shape[len(leading) :]), array.dtype) for array in arrays
    )


def _change_while_exact(tensions: jax.Array, arrays: Any, tangents: Any) -> jax.Array:
    """Return the change of exact tensions, as `tensionlab.AllocationJacobian` has it, in operations of JAX."""
    import jax.numpy as jnp

    structure, _, lower, upper, reference = arrays
    d_structure, d_wrench, d_lower, d_upper, d_reference = tangents
    free = (tensions > lower) & (tensions < upper)
    columns = jnp.where(free[..., None, :], structure, 0.0)
    inverse = jnp.linalg.pinv(columns)
    held = jnp.where(free, 0.0, jnp.where(tensions <= lower, d_lower, d_upper))
    missing = d_wrench - _times(d_structure, tensions) - _times(structure, held)
    multiplier = _times(jnp.swapaxes(inverse, -1, -2), jnp.where(free, tensions - reference, 0.0))
    wish = jnp.where(free, d_reference + _times(jnp.swapaxes(d_structure, -1, -2), multiplier), 0.0)
    change: jax.Array = held + _times(inverse, missing - _times(columns, wish)) + wish
    return change


def _times(matrix: Any, vector: Any) -> Any:
    return (matrix @ vector[..., None])[..., 0]
