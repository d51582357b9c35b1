"""The policies of the exact solver as a program of JAX, with derivatives."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from tensionlab.interop.jax_dual import Bounded, rank_tolerance, rounding_share, solution_on_face, solve
from tensionlab.interop.jax_scale_search import along_wrench, orthonormal_rows
from tensionlab.solvers.base import Policy


@partial(jax.jit, static_argnums=(0, 1))
def solve_batch(policy: Policy, weights: tuple[float, ...], *arrays: Array) -> tuple[Array, Array]:
    """Return the tensions (B, m) of five arrays of B problems, and which are proved optimal (B,)."""
    answers: tuple[Array, Array] = jax.vmap(_program(policy, weights))(*arrays)
    return answers


@cache
def _program(policy: Policy, weights: tuple[float, ...]) -> Any:
    """Return the function of the five arrays of one problem, with its derivatives."""
    roots = np.sqrt(weights)

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def allocation(*arrays: Array) -> tuple[Array, Array]:
        rows = orthonormal_rows(*arrays[:2])
        whitened = solve(rows.bounded(1.0, 1.0, *arrays[2:]))
        if policy == "tension":
            return whitened[:2]
        rendered = whitened[1] & _renders(whitened[0], *arrays[:4])
        nearest = solve(_least_error(policy, roots, *arrays), rendered, whitened)[:2]
        return along_wrench(rows, whitened, rendered, nearest, *arrays) if policy == "direction" else nearest

    @allocation.defjvp  # type: ignore[untyped-decorator]
    def changes(arrays: Any, tangents: Any) -> Any:
        tensions, optimal = allocation(*arrays)
        on_face = partial(_tensions_on_face, policy, roots, jax.lax.stop_gradient(tensions))
        change = jax.jvp(on_face, arrays, tangents)[1]
        return (tensions, optimal), (change, jnp.zeros(optimal.shape, jax.dtypes.float0))

    return allocation


def _least_error(
    policy: Policy,
    roots: NDArray[np.float64],
    structure: Array,
    wrench: Array,
    lower: Array,
    upper: Array,
    reference: Array,
) -> Bounded:
    """Return the problem whose error is measured as the policy does; ``direction`` here as ``force``."""
    if policy == "tension":  # |W⁺ (w - W t)|
        inverse = jnp.linalg.pinv(structure, rtol=rank_tolerance(structure))
        return Bounded(inverse @ structure, inverse @ wrench, lower, upper, reference)
    scales = jnp.asarray(roots, structure.dtype)
    return Bounded(scales[:, None] * structure, scales * wrench, lower, upper, reference)


def _renders(tensions: Array, structure: Array, wrench: Array, lower: Array, upper: Array) -> Array:
    """Return whether tensions render a wrench up to rounding."""
    largest = jnp.abs(structure) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)) + jnp.abs(wrench)
    return jnp.all(jnp.abs(wrench - structure @ tensions) <= rounding_share(structure) * jnp.max(largest))


def _tensions_on_face(policy: Policy, roots: NDArray[np.float64], tensions: Array, *arrays: Array) -> Array:
    """Return the tensions as a smooth function of the arrays while no cable reaches or leaves a limit."""
    structure, wrench, lower, upper, reference = arrays
    # Where the largest share of a wrench is rendered, cables reach their limits up to rounding only.
    rounding = rounding_share(structure) * (upper - lower)
    low, high = tensions <= lower + rounding, tensions >= upper - rounding
    found, _ = solution_on_face(_least_error(policy, roots, *arrays), low, high)
    if policy != "direction":
        return found
    # With the share as one more unknown; unless all of the wrench is rendered, or nothing that has its direction.
    extended = Bounded(
        jnp.column_stack([structure, -wrench]),
        jnp.zeros_like(wrench),
        *(jnp.append(each, 0.0) for each in (lower, upper, reference)),
    )
    scaled = solution_on_face(extended, jnp.append(low, False), jnp.append(high, False))[0][:-1]
    share = (structure @ tensions) @ wrench / jnp.maximum(wrench @ wrench, jnp.finfo(wrench.dtype).tiny)
    keeps = _renders(tensions, structure, share * wrench, lower, upper)
    return jnp.where(keeps & ~_renders(tensions, *arrays[:4]), scaled, found)
