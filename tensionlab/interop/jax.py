"""Allocation and structure matrix as programs of JAX: differentiable, for batches, on any of its devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, optional_import
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import POLICIES, Policy

if TYPE_CHECKING:
    import jax

__all__ = ["ProvedTensions", "allocate", "solve", "structure_matrix"]


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


class ProvedTensions(NamedTuple):
    """Tensions of a batch, with what was proved of them.

    Attributes
    ----------
    tensions : (..., m) array, in N
    optimal : (...) array of bool
        Whether the conditions of optimality hold to rounding: the tensions are inside their limits, and no others
        render the wrench or, if it is infeasible, what the policy puts in its place, with less effort.
    """

    tensions: jax.Array
    optimal: jax.Array


def allocate(
    structure: ArrayLike | jax.Array,
    wrench: ArrayLike | jax.Array,
    limits: Any,
    reference: ArrayLike | jax.Array | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> jax.Array:
    """Return the tensions of `tensionlab.allocate`, for ``jax.grad``, ``jax.vmap`` and ``jax.jit``.

    Arguments are those of `tensionlab.allocate` with newton as the solver, as arrays of JAX; ``limits`` may be a
    pair, and ``policy`` and ``wrench_weights`` are no tracers. `solve` also returns what was proved.

    The program has a bounded number of steps and no callbacks: it runs where JAX runs, in the type of the arrays.
    JAX computes in float32 unless ``jax_enable_x64`` is set: wrenches then have four digits where the tensions are
    proved, and about one in a hundred is not.

    Derivatives exist in both modes, of any order, by all arrays but the weights: those of the tensions with every
    cable at a limit held there, as `tensionlab.AllocationJacobian` has them.

    Raises
    ------
    InputError
        If a word or the policy is unknown, or arrays do not fit together. Values are not checked: what is not
        finite, or limits the wrong way round, give tensions without proof.
    MissingDependency
        If JAX is not installed.

    Examples
    --------
    >>> from tensionlab.jax import allocate
    >>> tensions = allocate([[1.0, -1.0]], [2.0], (1.0, 5.0))
    >>> tensions.tolist()
    [3.0, 1.0]
    """
    return solve(structure, wrench, limits, reference, policy, wrench_weights).tensions


def solve(
    structure: ArrayLike | jax.Array,
    wrench: ArrayLike | jax.Array,
    limits: Any,
    reference: ArrayLike | jax.Array | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> ProvedTensions:
    """Return tensions as `allocate` does, and whether each row is proved optimal."""
    with optional_import("jax", "tensionlab.interop.jax"):
        import jax.numpy as jnp

        from tensionlab.interop import jax_solver
    lower, upper = limits if isinstance(limits, tuple) else (limits.lower, limits.upper)
    lower, upper = jnp.asarray(lower), jnp.asarray(upper)
    words = {"lower": lower, "middle": (lower + upper) / 2}
    if isinstance(reference, str) and reference not in words:
        raise InputError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
    if policy not in (None, *POLICIES):
        raise InputError(f"policy {policy!r} is unknown; choose one of {', '.join(POLICIES)}")
    near = words[reference] if isinstance(reference, str) else 0.0 if reference is None else reference
    given = [jnp.asarray(array) for array in (structure, wrench, lower, upper, near)]
    dtype, (n, m) = jnp.result_type(float, *given), given[0].shape[-2:]
    inner = ((n, m), (n,), (m,), (m,), (m,))
    pairs = list(zip(given, inner, strict=True))
    try:
        leading = jnp.broadcast_shapes(*(array.shape[: max(array.ndim - len(own), 0)] for array, own in pairs))
        arrays = [jnp.broadcast_to(array.astype(dtype), (*leading, *own)) for array, own in pairs]
    except ValueError:
        names = ("structure", "wrench", "lower", "upper", "reference")
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(names, given, strict=True))
        raise InputError(f"arrays do not fit together: {shapes}") from None
    weights = np.ones(n) if wrench_weights is None else np.broadcast_to(np.asarray(wrench_weights, float), n)
    flat = (array.reshape(-1, *own) for array, own in zip(arrays, inner, strict=True))
    tensions, optimal = jax_solver.solve_batch(policy or "force", tuple(weights.tolist()), *flat)
    return ProvedTensions(tensions.reshape(*leading, m), optimal.reshape(leading))
