"""Tensions with the least error as a program of JAX: proximal Newton steps on the dual, then the face found."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from tensionlab.solvers.base import RANK_TOLERANCE

Answer = tuple[Array, Array, Array]  # tensions, whether they are proved optimal, and what is missing of the target

STEPS, ROUNDS = 8, 30  # Newton steps between two attempts at a proof, and attempts at most
# Weight of the proximal term at first and at last, as a share of the longest column's square.
FIRST_PROXIMITY, LAST_PROXIMITY = 1e-2, 1e-7
PATIENCE = 5  # rounds after which the last weight is a tenth


class Bounded(NamedTuple):
    """Tensions closest to ``reference`` of those inside the limits that minimise ``|columns t - target|``."""

    columns: Array  # (k, m)
    target: Array  # (k,)
    lower: Array
    upper: Array
    reference: Array


def rounding_share(array: Array) -> float:
    """Return the share of a quantity's size below which it is rounding, in the precision of an array."""
    return max(1e-9, 16.0 * float(jnp.finfo(array.dtype).eps))


def rank_tolerance(array: Array) -> float:
    """Return the share of the largest singular value below which others are zero, in the precision of an array."""
    return max(RANK_TOLERANCE, 1e3 * float(jnp.finfo(array.dtype).eps))


def solution_on_face(problem: Bounded, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the solution with some cables held at their lower and upper limits, and the inverse of the others."""
    columns, target, lower, upper, reference = problem
    free = ~(low | high)
    inverse = jnp.linalg.pinv(jnp.where(free, columns, 0.0), rtol=1e3 * float(jnp.finfo(columns.dtype).eps))
    held = jnp.where(low, lower, jnp.where(high, upper, reference))
    return held + jnp.where(free, inverse @ (target - columns @ held), 0.0), inverse


def solve(problem: Bounded, known: Any = False, answer: Any = None) -> Answer:
    """Return tensions, whether they are proved optimal, and the missing ``target - columns t``.

    Each round takes proximal steps on the dual (`_newton_step`) and attempts a proof (`_proof`). The proximal term
    falls with the rounds: it holds the steps back where the free cables hardly determine the multiplier.

    Sources: Chiche and Gilbert (2016) for proximal steps on infeasible problems, Qi and Sun (1993) for the
    semismooth method.
    """
    columns, target, lower, upper, reference = problem
    rounding = float(jnp.finfo(columns.dtype).eps)
    square = jnp.max(jnp.sum(columns * columns, axis=0)) + jnp.finfo(columns.dtype).tiny
    size = jnp.max(jnp.abs(target)) + jnp.max(jnp.abs(columns) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)))

    def attempt(state: Any) -> Any:
        dual, _, _, _, rounds = state
        last = jnp.maximum(LAST_PROXIMITY * 10.0 ** -(rounds // PATIENCE), 1e2 * rounding) * square
        step = partial(_newton_step, problem, 1e4 * rounding * size, last)
        dual = jax.lax.fori_loop(0, STEPS, lambda _, dual: step(dual), dual)
        return dual, *_proof(problem, dual[0], square, size), rounds + 1

    start = jnp.zeros_like(target)
    dual = start, start, FIRST_PROXIMITY * square
    tensions, optimal, missing = answer or (jnp.clip(reference, lower, upper), False, target)
    state = dual, tensions, jnp.asarray(known), jnp.zeros_like(target), 0
    _, tensions, optimal, missing, _ = jax.lax.while_loop(lambda s: ~s[2] & (s[4] < ROUNDS), attempt, state)
    return tensions, optimal, missing


def _proof(problem: Bounded, multiplier: Array, square: Array, size: Array) -> Answer:
    """Solve the linear problem of the face on which a multiplier puts the tensions, and check its optimality.

    The solution is optimal if it is inside the limits and no cable could reduce the error by a change that its
    limits allow; and if a multiplier shows that no tensions of the same error are closer to the reference.
    Cables whose change would increase the error are not among those, whatever the multiplier.
    """
    columns, target, lower, upper, reference = problem
    rounding = 16.0 * float(jnp.finfo(columns.dtype).eps)
    pull = reference + columns.T @ multiplier
    low, high = pull <= lower, pull >= upper
    free = ~(low | high)
    solution, inverse = solution_on_face(problem, low, high)
    solution += jnp.where(free, inverse @ (target - columns @ solution), 0.0)  # once more, for what rounding left
    error = target - columns @ solution
    missing = error - inverse.T @ jnp.where(free, columns.T @ error, 0.0)  # normal to the free cables exactly
    push, still = jnp.where(free, columns.T @ error, columns.T @ missing), rounding * jnp.sqrt(square) * size
    stays = (high | (push <= still)) & (low | (push >= -still))
    # Without its part along the missing wrench, which grows from step to step and pulls at no free cable.
    length = jnp.linalg.norm(missing)
    unit = jnp.where(length > rounding * size, missing / jnp.where(length > 0, length, 1.0), 0.0)
    on_face = multiplier - unit * (unit @ multiplier)
    on_face += inverse.T @ jnp.where(free, solution - reference - columns.T @ on_face, 0.0)
    closest = reference + columns.T @ on_face
    negligible = rounding_share(columns) * (upper - lower) + rounding * jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    alike = negligible + rounding * jnp.sqrt(square) * jnp.sum(jnp.abs(on_face))
    same = (high | (low & (push < -still)) | (closest <= solution + alike)) & (
        low | (high & (push > still)) | (closest >= solution - alike)
    )
    inside = jnp.clip(solution, lower, upper)
    within = jnp.abs(solution - inside) <= negligible
    optimal = jnp.all(stays & same & within & (lower <= upper))
    tensions = jnp.where(optimal, inside, jnp.clip(pull, lower, upper))
    return tensions, optimal, jnp.where(optimal, missing, target - columns @ tensions)


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
