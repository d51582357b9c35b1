"""An independent judge: the exact answer of one problem, by methods that share nothing with the package.

An active-set least-squares routine, a simplex code and DAQP find which cables are at their limits; the
equations that remain are then solved again in NumPy. The answer is held against the optimality conditions,
whose multipliers are found afterwards by non-negative least squares; where those leave a doubt (a gradient or
an error that is neither zero nor clearly not) the judge says so by raising `UnsureError` rather than guess.
`test_optimality` holds a second judge against this one, which tries every pattern of limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import daqp
import numpy as np
from scipy.optimize import linprog, lsq_linear, nnls

from tensionlab.support.arrays import Floats
from tests.helpers.problems import Case

ZERO = 1e-10  # a number below this, relative to the size of the problem, is zero ..
CLEAR = 1e-6  # ... and one above this is not. Between the two rounded data do not tell.
RANK = 1e-8  # share of the largest singular value below which one counts as zero: the package's published rule


class UnsureError(Exception):
    """The problem is too close to a tie for its answer to be known to 1e-9 N."""


@dataclass(frozen=True)
class Truth:
    """The exact answer of one problem.

    ``error`` is the norm of the remaining error in the policy's own metric (for "direction": ``1 - scale``,
    or the force error where no scale keeps the direction). ``separation`` is a unit vector d with ``d·w``
    above every reachable ``d·W t``, or zeros where the wrench is reachable.
    """

    tensions: Floats
    wrench: Floats
    scale: float
    error: float
    separation: Floats
    reachable: bool


@dataclass(frozen=True)
class Box:
    """What every step needs: limits, reference, and the size that tolerances are relative to."""

    lower: Floats
    upper: Floats
    reference: Floats
    size: float


# Of the t in the box that make |V t - y| least, the one closest to the reference: `f(V, y, box)`.
Policy = Callable[[Floats, Floats, Box], Floats]
# Largest s in [0, 1] with `W t = s w` in the box, given that there is one: `f(W, w, box)`.
Furthest = Callable[[Floats, Floats, Box], float]


def along_ray(W: Floats, w: Floats, box: Box) -> tuple[Floats, Box]:
    """What ``W t = s w`` with s in [0, 1] is in the unknowns (t, s |w|): a matrix to be zero, and their box."""
    length = float(np.linalg.norm(w)) or 1.0
    matrix = np.column_stack([W, -w / length])
    last = ((box.lower, 0.0), (box.upper, length), (box.reference, length))
    lower, upper, reference = (np.append(x, end) for x, end in last)
    return matrix, Box(lower, upper, reference, box.size)


def support(W: Floats, d: Floats, lower: Floats, upper: Floats) -> float:
    """Return the largest ``d·W t`` of tensions in the box, in N."""
    gain = W.T @ d
    return float(np.maximum(gain * lower, gain * upper).sum())


def solve(case: Case, policy: str) -> Truth:
    """Return the best tensions, by numerical solvers and a polish; for any number of cables.

    Raises `UnsureError` where they are not determined to 1e-9 N.
    """
    return judge(case, policy, _nearest_by_solvers, _furthest_by_simplex)


def judge(case: Case, policy: str, closest: Policy, furthest: Furthest) -> Truth:
    """Assemble and verify the answer of a policy from the two steps that a method provides."""
    W, w = case.structure, case.wrench
    sizes = [float(np.abs(x).max()) for x in (w, case.lower, case.upper, case.reference)]
    box = Box(case.lower, case.upper, case.reference, max(1.0, *sizes) * max(1.0, float(np.abs(W).max())))
    sigma = np.linalg.svd(W, compute_uv=False) / max(float(np.linalg.norm(W, 2)), np.finfo(float).tiny)
    if np.any((sigma > ZERO) & (sigma < CLEAR)):
        raise UnsureError("the rank of the structure matrix")
    force = np.diag(np.sqrt(case.weights))
    t = closest(force @ W, force @ w, box)
    r = force @ (w - W @ t)
    _check_least(force @ W, r, t, box)
    if _is_zero(float(np.linalg.norm(r)), box):
        _check_closest(force @ W, force @ w, t, box)
        return Truth(t, W @ t, 1.0, 0.0, np.zeros_like(w), reachable=True)
    if policy == "direction":
        matrix, ray = along_ray(W, w, box)
        ts = closest(matrix, np.zeros_like(w), ray)
        _check_least(matrix, -matrix @ ts, ts, ray)
        if _is_zero(float(np.linalg.norm(matrix @ ts)), box):
            return _judge_direction(W, w, box, closest, furthest)
    root = force if policy != "tension" else _tension_metric(W)
    if policy == "tension":
        t = closest(root @ W, root @ w, box)
        r = root @ (w - W @ t)
    _check_least(root @ W, r, t, box)
    _check_closest(root @ W, root @ W @ t, t, box)
    error = float(np.linalg.norm(r))
    d = root.T @ r
    if policy == "tension" and _is_zero(error, box):  # only what no tension can render is missing
        d = w - W @ t
    return Truth(t, W @ t, float("nan"), error, d / np.linalg.norm(d), reachable=False)


def _judge_direction(W: Floats, w: Floats, box: Box, closest: Policy, furthest: Furthest) -> Truth:
    s = furthest(W, w, box)
    t = closest(W, s * w, box)
    _check_closest(W, s * w, t, box)
    # d with d·w = 1 that no cable can push further along: d·W_i is 0 for a cable between its limits.
    d = _multiplier(np.vstack([W.T, w]), np.append(np.zeros_like(t), 1.0), _sides(t, box), 1.0)
    if abs(support(W, d, box.lower, box.upper) - s) > ZERO * box.size * max(1.0, float(np.abs(d).sum())):
        raise UnsureError("the scale is not proved to be the largest")
    return Truth(t, W @ t, s, 1.0 - s, d / np.linalg.norm(d), reachable=False)


def _tension_metric(W: Floats) -> Floats:
    """Root of (W W')^+, such that root @ W has orthonormal rows."""
    U, sigma, _ = np.linalg.svd(W, full_matrices=False)
    keep = sigma > RANK * max(float(sigma[0]), np.finfo(float).tiny)
    return np.asarray(U[:, keep].T / sigma[keep, None])


def _is_zero(x: float, box: Box) -> bool:
    if ZERO * box.size < x < CLEAR * box.size:
        raise UnsureError(f"{x:g} is neither zero nor clearly not")
    return x <= ZERO * box.size


# --- Verification -----------------------------------------------------------------------------------------


def _sides(t: Floats, box: Box) -> Floats:
    """-1 at the lower limit, 1 at the upper, 0 between, NaN where both limits are the same."""
    low, high = t - box.lower <= ZERO * box.size, box.upper - t <= ZERO * box.size
    side = high.astype(float) - low
    side[low & high] = np.nan
    return side


def _multiplier(rows: Floats, target: Floats, sides: Floats, size: float) -> Floats:
    """Find x with ``rows @ x = target`` between the limits, ``<=`` at lower ones and ``>=`` at upper ones."""
    m, n = len(sides), rows.shape[1]
    extra = len(rows) - m
    slack = np.vstack([-np.diag(sides), np.zeros((extra, m))])[:, ~np.isnan(sides) & (sides != 0)]
    use = np.append(~np.isnan(sides), np.ones(extra, dtype=bool))
    matrix = np.hstack([rows, -rows, slack])[use]
    if matrix.size:
        solution, residual = nnls(matrix, target[use], maxiter=50 * matrix.shape[1])
    else:  # SciPy's routine writes outside its memory
        solution, residual = np.zeros(matrix.shape[1]), np.sqrt(np.sum(target[use] ** 2))
    if not residual <= 10 * ZERO * size:
        raise UnsureError(f"no multiplier proves the answer ({residual:g})")
    return np.asarray(solution[:n] - solution[n : 2 * n])


def _check_least(V: Floats, r: Floats, t: Floats, box: Box) -> None:
    """Does r = y - V t have the least norm: its pull V'r must push every free cable against a limit."""
    pull = V.T @ r
    unclear = (np.abs(pull) > ZERO * box.size) & (np.abs(pull) < CLEAR * box.size)
    if np.any(unclear & (box.lower < box.upper)):
        raise UnsureError("a cable may or may not be at its limit")
    if np.any(np.abs(np.clip(t + pull, box.lower, box.upper) - t) > ZERO * box.size):
        raise UnsureError("the error is not proved to be the least")


def _check_closest(V: Floats, v: Floats, t: Floats, box: Box) -> None:
    """Is t the point of ``V t = v`` in the box that is closest to the reference."""
    if np.abs(V @ t - v).max(initial=0.0) > ZERO * box.size:
        raise UnsureError("the tensions do not render the wrench")
    if np.any(t < box.lower) or np.any(t > box.upper):
        raise UnsureError("the tensions are not inside their limits")
    _multiplier(V.T, t - box.reference, _sides(t, box), box.size)


# --- The method: numerical solvers, then the identified equations ------------------------------------------


def _nearest_by_solvers(V: Floats, y: Floats, box: Box) -> Floats:
    t, free = box.lower.copy(), box.upper > box.lower
    if not np.any(free) or not len(V):
        return np.clip(box.reference, box.lower, box.upper)
    limits = (box.lower[free], box.upper[free])
    with np.errstate(divide="ignore", invalid="ignore"):  # a step of length zero, which it then skips
        t[free] = lsq_linear(V[:, free], y - V[:, ~free] @ t[~free], limits, "bvls", 1e-15, max_iter=1000).x
    r = y - V @ t
    if np.linalg.norm(r) > CLEAR * box.size:  # what pulls a cable keeps it at its limit
        pull = V.T @ r
        held = np.abs(pull) > CLEAR * box.size
        t[held] = np.where(pull > 0, box.upper, box.lower)[held]
        free &= ~held
    if not np.any(free):
        return t
    rows, target = _independent(V[:, free], y - V[:, ~free] @ t[~free])
    face = Box(box.lower[free], box.upper[free], box.reference[free], box.size)
    t[free] = _project(rows, target, face)
    return t


def _independent(V: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Orthonormal equations with the least-squares solutions of ``V t = y``."""
    U, sigma, rows = np.linalg.svd(V, full_matrices=False)
    keep = sigma > 1e-13 * max(1.0, float(sigma[0]))
    return rows[keep], (U.T @ y)[keep] / sigma[keep]


def _project(rows: Floats, target: Floats, box: Box) -> Floats:
    """Closest point to the reference of ``rows t = target`` in the box: DAQP, then its equations again."""
    upper, lower = np.append(box.upper, target), np.append(box.lower, target)
    if not len(target):
        return np.clip(box.reference, box.lower, box.upper)
    sense = np.append(np.zeros(len(box.upper), np.int32), np.full(len(target), 5, np.int32))
    start, _, flag, _ = daqp.solve(
        np.eye(len(box.upper)), -box.reference, rows, upper, lower, sense, primal_tol=1e-9 * box.size
    )
    if flag < 1:
        raise UnsureError(f"DAQP stopped with {flag}")
    side = _sides(start, Box(box.lower, box.upper, box.reference, 1e2 * box.size))
    t, free = np.where(side > 0, box.upper, box.lower), side == 0
    t[free] = box.reference[free]
    t[free] += np.linalg.pinv(rows[:, free], rcond=1e-13) @ (target - rows @ t)
    return np.asarray(np.clip(t, box.lower, box.upper))


def _furthest_by_simplex(W: Floats, w: Floats, box: Box) -> float:
    matrix, ray = along_ray(W, w, box)
    limits = list(zip(ray.lower, ray.upper, strict=True))
    gain = np.append(np.zeros(len(box.lower)), 1.0)
    found = linprog(-gain, A_eq=matrix, b_eq=np.zeros_like(w), bounds=limits)
    if found.x is None:
        raise UnsureError(found.message)
    x = found.x
    free = _sides(x, Box(ray.lower, ray.upper, ray.reference, 1e2)) == 0
    t = np.where(free, x, np.where(ray.upper - x < x - ray.lower, ray.upper, ray.lower))
    t[free] -= np.linalg.pinv(matrix[:, free], rcond=1e-13) @ (matrix @ t)
    return float(np.clip(t[-1] / ray.upper[-1], 0.0, 1.0))
