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
# Largest difference between tensions of the multiplier and those of its face, as a share of the limits' distance.
FACE_TOLERANCE = 1e-5


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


def solution_on_face(problem: Bounded, low: Array, high: Array) -> Array:
    """Return the solution with some cables held at their lower and upper limits and the others free."""
    columns, target, lower, upper, reference = problem
    free = ~(low | high)
    held = jnp.where(low, lower, jnp.where(high, upper, reference))
    inverse = jnp.linalg.pinv(jnp.where(free, columns, 0.0), rtol=rank_tolerance(columns))
    return held + jnp.where(free, inverse @ (target - columns @ held), 0.0)


def solve(problem: Bounded, known: Any = False, answer: Any = None) -> Answer:
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
        exact = solution_on_face(problem, low, high)
        missing = target - columns @ exact
        push, negligible = columns.T @ missing, rounding_share(columns) * jnp.sqrt(square) * size
        held = jnp.where(low, push <= negligible, ~high | (push >= -negligible))
        alike = max(FACE_TOLERANCE, 1e4 * rounding) * jnp.max(upper - lower) + rounding * largest
        same = jnp.abs(exact - tensions) <= alike
        inside = jnp.clip(exact, lower, upper)
        within = jnp.abs(exact - inside) <= rounding_share(columns) * jnp.maximum(
            upper - lower, rounding * largest
        )
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
