"""The exact solver as a program of JAX: proximal Newton steps on the dual, then the face that they find."""

from __future__ import annotations

from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from tensionlab.solvers.base import RANK_TOLERANCE, Policy

Answer = tuple[Array, Array, Array]  # tensions, whether they are proved optimal, and what is missing of the target

STEPS, ROUNDS = 8, 30  # Newton steps between two attempts at a proof, and attempts at most
CUTS = 20  # scales at most that the direction policy tries
# Weight of the proximal term at first and at last, as a share of the longest column's square.
FIRST_PROXIMITY, LAST_PROXIMITY = 1e-2, 1e-7
# Largest difference between tensions of the multiplier and those of its face, as a share of the limits' distance.
FACE_TOLERANCE = 1e-5


class Bounded(NamedTuple):
    """Tensions closest to ``reference`` of those inside the limits that minimise ``|columns t - target|``."""

    columns: Array  # (k, m)
    target: Array  # (k,)
    lower: Array
    upper: Array
    reference: Array


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
        whitened = _solve(problem)
        if policy == "tension":
            return whitened[:2]
        rendered = whitened[1] & _renders(whitened[0], *arrays[:4])
        found = _solve(_least_error(policy, roots, *arrays), rendered, whitened)
        return _along_wrench(problem, whitened, found, *arrays[:2]) if policy == "direction" else found[:2]

    @allocation.defjvp  # type: ignore[untyped-decorator]
    def changes(arrays: Any, tangents: Any) -> Any:
        tensions, optimal = allocation(*arrays)
        on_face = partial(_tensions_on_face, policy, roots, jax.lax.stop_gradient(tensions))
        change = jax.jvp(on_face, arrays, tangents)[1]
        return (tensions, optimal), (change, jnp.zeros(optimal.shape, jax.dtypes.float0))

    return allocation


def _negligible(array: Array) -> float:
    """Return the share of a quantity's size below which it is rounding, in the precision of an array."""
    return max(1e-9, 16.0 * float(jnp.finfo(array.dtype).eps))


def _rank_tolerance(array: Array) -> float:
    """Return the share of the largest singular value below which others are zero, in the precision of an array."""
    return max(RANK_TOLERANCE, 1e3 * float(jnp.finfo(array.dtype).eps))


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
        inverse = jnp.linalg.pinv(structure, rtol=_rank_tolerance(structure))
        return Bounded(inverse @ structure, inverse @ wrench, lower, upper, reference)
    scales = jnp.asarray(roots, structure.dtype)
    return Bounded(scales[:, None] * structure, scales * wrench, lower, upper, reference)


def _whitened(structure: Array, wrench: Array, lower: Array, upper: Array, reference: Array) -> Bounded:
    """Return the problem with orthonormal rows, in which near-singular structure matrices do no harm."""
    left, values, rows = jnp.linalg.svd(structure, full_matrices=False)
    known = values > _rank_tolerance(structure) * values[0]
    target = jnp.where(known, left.T @ wrench, 0.0) / jnp.where(known, values, 1.0)
    return Bounded(jnp.where(known[:, None], rows, 0.0), target, lower, upper, reference)


def _renders(tensions: Array, structure: Array, wrench: Array, lower: Array, upper: Array) -> Array:
    """Return whether tensions render a wrench up to rounding."""
    largest = jnp.abs(structure) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)) + jnp.abs(wrench)
    return jnp.all(jnp.abs(wrench - structure @ tensions) <= _negligible(structure) * jnp.max(largest))


def _solution_on_face(problem: Bounded, low: Array, high: Array) -> Array:
    """Return the solution with some cables held at their lower and upper limits and the others free."""
    columns, target, lower, upper, reference = problem
    free = ~(low | high)
    held = jnp.where(low, lower, jnp.where(high, upper, reference))
    inverse = jnp.linalg.pinv(jnp.where(free, columns, 0.0), rtol=_rank_tolerance(columns))
    return held + jnp.where(free, inverse @ (target - columns @ held), 0.0)


def _solve(problem: Bounded, known: Any = False, answer: Any = None) -> Answer:
    """Return tensions, whether they are proved optimal, and the missing ``target - columns t``.

    Each round takes proximal steps on the dual (`_newton_step`), and then solves the linear problem of the face
    on which the multiplier puts the tensions. That solution is the answer if it is inside the limits, no cable at
    a limit could reduce the error by leaving it, and the multiplier has the same tensions: then none with the
    same error are closer to the reference.

    Sources: Chiche and Gilbert (2016) for proximal steps on infeasible problems, Qi and Sun (1993) for the
    semismooth method.
    """
    columns, target, lower, upper, reference = problem
    rounding = float(jnp.finfo(columns.dtype).eps)
    square = jnp.max(jnp.sum(columns * columns, axis=0)) + jnp.finfo(columns.dtype).tiny
    largest = jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    size = jnp.max(jnp.abs(target)) + jnp.max(jnp.abs(columns) @ largest)

    def attempt(state: Any) -> Any:
        dual, _, _, _, rounds = state
        step = partial(_newton_step, problem, 1e4 * rounding * size, max(LAST_PROXIMITY, 1e2 * rounding) * square)
        dual = jax.lax.fori_loop(0, STEPS, lambda _, dual: step(dual), dual)
        pull = reference + columns.T @ dual[0]
        tensions, low, high = jnp.clip(pull, lower, upper), pull <= lower, pull >= upper
        exact = _solution_on_face(problem, low, high)
        missing = target - columns @ exact
        push, negligible = columns.T @ missing, _negligible(columns) * jnp.sqrt(square) * size
        held = jnp.where(low, push <= negligible, ~high | (push >= -negligible))
        alike = max(FACE_TOLERANCE, 1e4 * rounding) * jnp.max(upper - lower) + rounding * largest
        same = jnp.abs(exact - tensions) <= alike
        inside = jnp.clip(exact, lower, upper)
        within = jnp.abs(exact - inside) <= _negligible(columns) * jnp.maximum(upper - lower, rounding * largest)
        optimal = jnp.all(held & same & within & (lower <= upper))
        return dual, jnp.where(optimal, inside, tensions), optimal, missing, rounds + 1

    start = jnp.zeros_like(target)
    dual = start, start, FIRST_PROXIMITY * square
    tensions, optimal, missing = answer or (jnp.clip(reference, lower, upper), False, target)
    state = dual, tensions, jnp.asarray(known), jnp.zeros_like(target), 0
    _, tensions, optimal, missing, _ = jax.lax.while_loop(lambda s: ~s[2] & (s[4] < ROUNDS), attempt, state)
    return tensions, optimal, missing


def _newton_step(problem: Bounded, tolerance: Array, last: Array, dual: Any) -> Any:
    """Move the multiplier towards the proximal problem's, or, from there, begin the next one with less weight."""
    columns, target, lower, upper, reference = problem
    multiplier, centre, proximity = dual
    pull = reference + columns.T @ multiplier
    slope = columns @ jnp.clip(pull, lower, upper) - target + proximity * (multiplier - centre)
    free = (pull > lower) & (pull < upper)
    curvature = (columns * free) @ columns.T + proximity * jnp.eye(len(target), dtype=columns.dtype)
    step = -jax.scipy.linalg.solve(curvature, slope, assume_a="pos")
    outside = proximity * (step @ (multiplier - centre)) - step @ target
    length = _step_length(problem, pull, columns.T @ step, outside, proximity * (step @ step))
    solved = jnp.max(jnp.abs(slope)) <= tolerance
    return (
        jnp.where(solved, multiplier, multiplier + length * step),
        jnp.where(solved, multiplier, centre),
        jnp.where(solved, jnp.maximum(0.1 * proximity, last), proximity),
    )


def _step_length(problem: Bounded, pull: Array, change: Array, slope: Array, curvature: Array) -> Array:
    """Return where the slope along a step is zero: ``change' clip(pull + s change) + slope + s curvature``."""
    lower, upper = problem.lower, problem.upper
    moving = change != 0
    kinks = jnp.stack([lower - pull, upper - pull]) / jnp.where(moving, change, 1.0)
    kinks = jnp.where(moving & (kinks > 0) & jnp.isfinite(kinks), kinks, 0.0).ravel()

    def slope_at(length: Array) -> Array:
        tensions = jnp.clip(pull + length[..., None] * change, lower, upper)
        return tensions @ change + slope + length * curvature

    slopes = slope_at(kinks)
    before = jnp.max(jnp.where(slopes < 0, kinks, 0.0))
    after = jnp.min(jnp.where((slopes >= 0) & (kinks > 0), kinks, jnp.inf))
    between = pull + jnp.where(jnp.isfinite(after), (before + after) / 2, before + 1.0) * change
    free = (between > lower) & (between < upper)
    return jnp.minimum(before - slope_at(before) / (jnp.sum(jnp.where(free, change**2, 0.0)) + curvature), after)


def _along_wrench(
    problem: Bounded, first: Answer, nearest: Answer, structure: Array, wrench: Array
) -> tuple[Array, Array]:
    """Return the tensions of the largest feasible share of the wrench, or the nearest ones where there is none.

    The error of each share is a direction that separates it; the share falls to the largest that this direction
    allows, until one is feasible. ``first`` is the answer to the whole wrench, the whitened ``problem``.
    """
    columns, target, lower, upper, _ = problem
    negligible = _negligible(structure)
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
        return share, _solve(problem._replace(target=share * target)), cuts + 1

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
    rounding = _negligible(structure) * (upper - lower)
    low, high = tensions <= lower + rounding, tensions >= upper - rounding
    found = _solution_on_face(_least_error(policy, roots, *arrays), low, high)
    if policy != "direction":
        return found
    # With the share as one more unknown; unless all of the wrench is rendered, or nothing that has its direction.
    extended = Bounded(
        jnp.column_stack([structure, -wrench]),
        jnp.zeros_like(wrench),
        *(jnp.append(each, 0.0) for each in (lower, upper, reference)),
    )
    scaled = _solution_on_face(extended, jnp.append(low, False), jnp.append(high, False))[:-1]
    share = (structure @ tensions) @ wrench / jnp.maximum(wrench @ wrench, jnp.finfo(wrench.dtype).tiny)
    keeps = _renders(tensions, structure, share * wrench, lower, upper)
    return jnp.where(keeps & ~_renders(tensions, *arrays[:4]), scaled, found)
