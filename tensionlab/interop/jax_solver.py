"""The policies of the exact solver as a program of JAX, with derivatives."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from tensionlab.interop.jax_dual import Answer, Bounded, rank_tolerance, rounding_share, solution_on_face, solve
from tensionlab.solvers.base import Policy

CUTS = 20  # scales at most that the direction policy tries


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
        problem = _whitened(*arrays)
        whitened = solve(problem)
        if policy == "tension":
            return whitened[:2]
        rendered = whitened[1] & _renders(whitened[0], *arrays[:4])
        found = solve(_least_error(policy, roots, *arrays), rendered, whitened)
        return _along_wrench(problem, whitened, found, *arrays[:2]) if policy == "direction" else found[:2]

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


def _whitened(structure: Array, wrench: Array, lower: Array, upper: Array, reference: Array) -> Bounded:
    """Return the problem with orthonormal rows, in which near-singular structure matrices do no harm."""
    left, values, rows = jnp.linalg.svd(structure, full_matrices=False)
    known = values > rank_tolerance(structure) * values[0]
    target = jnp.where(known, left.T @ wrench, 0.0) / jnp.where(known, values, 1.0)
    return Bounded(jnp.where(known[:, None], rows, 0.0), target, lower, upper, reference)


def _renders(tensions: Array, structure: Array, wrench: Array, lower: Array, upper: Array) -> Array:
    """Return whether tensions render a wrench up to rounding."""
    largest = jnp.abs(structure) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)) + jnp.abs(wrench)
    return jnp.all(jnp.abs(wrench - structure @ tensions) <= rounding_share(structure) * jnp.max(largest))


def _along_wrench(
    problem: Bounded, first: Answer, nearest: Answer, structure: Array, wrench: Array
) -> tuple[Array, Array]:
    """Return the tensions of the largest feasible share of the wrench, or the nearest ones where there is none.

    The error of each share is a direction that separates it; the share falls to the largest that this direction
    allows, until one is feasible. ``first`` is the answer to the whole wrench, the whitened ``problem``.
    """
    columns, target, lower, upper, _ = problem
    negligible = rounding_share(structure)
    reaches = jnp.abs(columns) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)) + jnp.abs(target)

    def infeasible(state: Any) -> Array:
        share, (_, _, missing), cuts = state
        return (share >= 0) & (cuts < CUTS) & jnp.any(jnp.abs(missing) > negligible * jnp.max(reaches))

    def cut(state: Any) -> Any:
        share, (_, _, missing), cuts = state
        pull, along = columns.T @ missing, missing @ target
        reach = jnp.sum(jnp.maximum(pull * lower, pull * upper))
        possible = (along > 0) & (reach >= 0)
        share = jnp.where(possible, jnp.minimum(reach / jnp.where(possible, along, 1.0), share), -1.0)
        return share, solve(problem._replace(target=share * target)), cuts + 1

    # A wrench with a part that no tensions render has no feasible share but zero.
    inside = jnp.linalg.norm(wrench - structure @ (columns.T @ target)) <= negligible * jnp.linalg.norm(wrench)
    first = tuple(
        jnp.where(inside, each, part) for each, part in zip(first, (first[0], False, target), strict=True)
    )
    share, (tensions, optimal, _), _ = jax.lax.while_loop(infeasible, cut, (jnp.where(inside, 1.0, 0.0), first, 0))
    optimal &= _renders(tensions, structure, share * wrench, lower, upper)
    return jnp.where(share >= 0, tensions, nearest[0]), jnp.where(share >= 0, optimal, nearest[1])


def _tensions_on_face(policy: Policy, roots: NDArray[np.float64], tensions: Array, *arrays: Array) -> Array:
    """Return the tensions as a smooth function of the arrays while no cable reaches or leaves a limit."""
    structure, wrench, lower, upper, reference = arrays
    # Where the largest share of a wrench is rendered, cables reach their limits up to rounding only.
    rounding = rounding_share(structure) * (upper - lower)
    low, high = tensions <= lower + rounding, tensions >= upper - rounding
    found = solution_on_face(_least_error(policy, roots, *arrays), low, high)
    if policy != "direction":
        return found
    # With the share as one more unknown; unless all of the wrench is rendered, or nothing that has its direction.
    extended = Bounded(
        jnp.column_stack([structure, -wrench]),
        jnp.zeros_like(wrench),
        *(jnp.append(each, 0.0) for each in (lower, upper, reference)),
    )
    scaled = solution_on_face(extended, jnp.append(low, False), jnp.append(high, False))[:-1]
    share = (structure @ tensions) @ wrench / jnp.maximum(wrench @ wrench, jnp.finfo(wrench.dtype).tiny)
    keeps = _renders(tensions, structure, share * wrench, lower, upper)
    return jnp.where(keeps & ~_renders(tensions, *arrays[:4]), scaled, found)
