"""Allocation along time: tensions whose rates of change are limited as well.

The tensions t_k of K samples minimise ``sum |t_k - reference|²`` subject to ``W_k t_k = w_k``, the limits, and
``|t_k - t_(k-1)| <= rate dt``. With a basis N_k of the null space of W_k, ``t_k = p_k + N_k z_k`` renders w_k for
any z_k; the compiled interior-point method chooses the z_k, and its multipliers prove here what is claimed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.allocation import Allocation, allocate
from tensionlab.errors import InputError, ShapeError
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE, Status
from tensionlab.support.arrays import Floats, Limits, check_size, require_finite, tension_limits
from tensionlab.support.files.reading import brief
from tensionlab.support.formatting import format_count

# Of limits and rates, relative to the largest limit: a path on the border of what can be rendered counts as such.
RELAXATION = 1e-10


@dataclass(frozen=True, eq=False)
class PathAllocation:
    """Tensions along a path, and the proof that they are the best, or that there are none.

    Attributes
    ----------
    tensions : (K, m) array
        In N; NaN from the sample ``blocked`` on, and everywhere where UNPROVEN. Limits are kept exactly, rates and
        wrenches to rounding.
    status : Status
        EXACT: within ``distance`` of the optimum. NEAREST: no tensions inside limits and rates render the wrenches
        up to the sample ``blocked``. Both are proved. UNPROVEN: neither was.
    distance : float
        Upper bound of the distance to the optimum, the norm over all tensions, in N, by the duality gap. On the
        border of what can be rendered, the optimum is that with bounds wider by 1e-10 of the largest limit.
    blocked : int or None
        First sample that cannot be rendered after those before it; None if all can.
    iterations : int
        Iterations of the method, all its runs together.
    """

    tensions: Floats
    status: Status
    distance: float
    blocked: int | None
    iterations: int

    def __repr__(self) -> str:
        samples = format_count(len(self.tensions), "sample")
        if self.blocked is not None:
            return f"<PathAllocation of {samples}: sample {self.blocked} cannot be rendered after those before it>"
        return f"<PathAllocation of {samples}: {self.status.name}, within {self.distance:.2g} N of the optimum>"


def allocate_path(
    structure: ArrayLike,
    wrench: ArrayLike,
    limits: Limits | tuple[ArrayLike, ArrayLike],
    rate_limits: ArrayLike,
    dt: float,
    reference: ArrayLike | None = None,
) -> PathAllocation:
    """Return the tensions along a path that render all wrenches within limits and rates, nearest to a reference.

    ShapeError or InputError if shapes do not fit, or a rate or the time between samples is not above zero.

    Parameters
    ----------
    structure : (K, n, m) or (n, m) array
        Structure matrices of the samples, in order.
    wrench : (K, n) array
        Desired wrenches, in N and N·m.
    limits
        As in `tensionlab.allocate`, (m,), or (K, m) for limits of each sample.
    rate_limits : float or (m,) array
        Largest rates of change of the tensions, in N/s.
    dt : float
        Time between samples, in s.
    reference : (m,) array, optional
        Tensions to be near to, in N; zero if left out.

    Notes
    -----
    An interior-point method whose steps factor a block tridiagonal matrix: Rao, Wright and Rawlings, "Application
    of interior-point methods to model predictive control", 1998; Mehrotra, 1992. The proofs are ours.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tug_of_war, pulls = [[1.0, -1.0]], [[0.0], [0.0], [3.0]]  # two cables pull against each other
    >>> tl.allocate_path(tug_of_war, pulls, (1.0, 5.0), rate_limits=20.0, dt=0.1).tensions.round(3)
    array([[1., 1.],
           [2., 2.],
           [4., 1.]])
    """
    W, w = require_finite("structure", structure, 2), require_finite("wrench", wrench, 2)
    n, m = W.shape[-2:]
    check_size(n, m)
    if w.ndim != 2 or not len(w) or w.shape[1] != n or W.shape[:-2] not in ((), (len(w),)):
        raise ShapeError(f"structure {W.shape}, wrench {w.shape}: give (K, n, m) or (n, m), and (K, n)")
    lower, upper = (_broadcast("limits", bound, (len(w), m)) for bound in tension_limits(limits))
    rates = _broadcast("rate_limits", rate_limits, (m,))
    near = _broadcast("reference", 0.0 if reference is None else reference, (m,))
    if not (rates > 0.0).all() or not 0.0 < dt < math.inf:
        raise InputError(f"rate_limits {brief(rate_limits)}, dt {dt}: give rates and a time above zero")
    scale = float(np.maximum(abs(lower), abs(upper)).max()) or 1.0
    bounds = PathBounds(lower / scale, upper / scale, rates * dt / scale)
    path, rendered = _particular(np.broadcast_to(W, (len(w), n, m)), w / scale, near / scale, bounds)
    solution, blocked, iterations = _longest(path, len(w) if rendered.all() else int(rendered.argmin()))
    tensions = np.full((len(w), m), np.nan)
    if solution is None:
        return PathAllocation(tensions, Status.UNPROVEN, math.nan, None, iterations)
    count = len(solution.tensions)
    tensions[:count] = np.clip(scale * solution.tensions, lower[:count], upper[:count])
    status = Status.EXACT if blocked is None else Status.NEAREST
    return PathAllocation(tensions, status, scale * solution.distance, blocked, iterations)


def _broadcast(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    numbers = require_finite(name, values, 0)
    try:
        return np.broadcast_to(numbers, shape)
    except ValueError:
        raise ShapeError(f"{name} has shape {numbers.shape}; give one number, or {shape}") from None


class RateLimitedAllocator:
    """Allocator for a control loop whose tensions change at limited rates.

    Each answer is reachable from the one before, and keeps the next wrench reachable, which is extrapolated
    linearly. If no tensions keep it reachable, the reachable ones nearest to the reference are chosen; if no
    reachable ones render the wrench, those that render it best.

    Parameters
    ----------
    limits, reference
        As in `tensionlab.allocate`.
    rate_limits : float or (m,) array
        Largest rates of change of the tensions, in N/s.
    dt : float
        Time between calls, in s.

    Examples
    --------
    >>> import tensionlab as tl
    >>> allocate = tl.RateLimitedAllocator((1.0, 5.0), rate_limits=20.0, dt=0.1)
    >>> [allocate([[1.0, -1.0]], [pull]).tensions.round(3).tolist() for pull in (0.0, 1.0, 3.5)]
    [[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]]
    """

    def __init__(
        self,
        limits: Limits | tuple[ArrayLike, ArrayLike],
        rate_limits: ArrayLike,
        dt: float,
        reference: ArrayLike | None = None,
    ) -> None:
        self._limits, self._rates, self._dt, self._reference = limits, rate_limits, dt, reference
        self._last: tuple[Floats, Floats] | None = None  # tensions and wrench

    def __call__(
        self,
        structure: ArrayLike,
        wrench: ArrayLike,
        limits: Limits | tuple[ArrayLike, ArrayLike] | None = None,
        before: ArrayLike | None = None,
    ) -> Allocation:
        """Choose tensions for a structure matrix (n, m) and a wrench (n,), and remember them.

        If given, ``limits`` and ``before`` (m,) take the place of the allocator's limits and the last tensions.
        The status is proved for the tensions in reach.
        """
        W, w = require_finite("structure", structure, 2), require_finite("wrench", wrench, 1)
        given = tension_limits(self._limits if limits is None else limits)
        lower, upper = (_broadcast("limits", bound, W.shape[1:]) for bound in given)
        last_tensions, last_wrench = self._last or (None, w)
        start = last_tensions if before is None else np.asarray(before)
        lowest, highest = lower, upper
        if start is not None:
            start, change = np.clip(start, lower, upper), self._dt * np.asarray(self._rates)
            lowest, highest = np.maximum(lower, start - change), np.minimum(upper, start + change)
        ahead = [w, 2.0 * w - last_wrench], (np.stack([lowest, lower]), np.stack([highest, upper]))
        planned = allocate_path(W, *ahead, self._rates, self._dt, self._reference)
        kept = planned.tensions[0] if planned.status is Status.EXACT else self._reference
        allocation = allocate(W, w, (lowest, highest), reference=kept)
        self._last = allocation.tensions, w
        return allocation


class PathBounds(NamedTuple):
    """Limits (K, m), and largest changes from sample to sample (m,), relative to the largest limit."""

    lower: Floats
    upper: Floats
    change: Floats


@dataclass(frozen=True, eq=False)
class Path:
    """Constraints ``G z <= space`` of a path of K samples, in the coordinates z (K, r) of ``t = p + N z``.

    The rows are upper limits, lower limits, rises and falls, (4K - 2, m). The norm of z is the distance of the
    tensions to those nearest to the reference that render the wrenches whatever the limits.
    """

    particular: Floats  # p, (K, m)
    basis: Floats  # N, (K, m, r), orthonormal or zero columns
    bounds: PathBounds

    def until(self, count: int) -> Path:
        """Return the path of the first samples."""
        lower, upper, change = self.bounds
        bounds = PathBounds(lower[:count], upper[:count], change)
        return Path(self.particular[:count], self.basis[:count], bounds)

    @cached_property
    def space(self) -> Floats:
        """What the particular tensions leave of each bound."""
        lower, upper, change = self.bounds
        step = np.diff(self.particular, axis=0)
        rows = [upper - self.particular, self.particular - lower, change - step, change + step]
        return np.concatenate(rows)

    @cached_property
    def reach(self) -> Floats:
        """Largest norm of each z_k inside the limits, (K,)."""
        lower, upper, _ = self.bounds
        return np.asarray(
            np.linalg.norm(np.maximum(abs(upper - self.particular), abs(self.particular - lower)), axis=1)
        )

    def rows(self, z: Floats) -> Floats:
        """Return G z."""
        t = (self.basis @ z[..., None])[..., 0]
        step = np.diff(t, axis=0)
        return np.concatenate([t, -t, step, -step])

    def pull_back(self, rows: Floats) -> Floats:
        """Return G' of a number for each constraint, (K, r)."""
        upper, lower, rise, fall = np.split(rows, np.cumsum([len(self.basis)] * 2 + [len(self.basis) - 1]))
        t, step = upper - lower, rise - fall
        t[1:] += step
        t[:-1] -= step
        return np.asarray(np.einsum("kmr,km->kr", self.basis, t))


def _particular(
    structure: Floats, wrench: Floats, reference: Floats, bounds: PathBounds
) -> tuple[Path, NDArray[np.bool_]]:
    """Return the path, and which samples some tensions render, whatever their limits, (K,)."""
    U, sigma, Vt = np.linalg.svd(structure)
    known = sigma > RANK_TOLERANCE * sigma[:, :1]
    inverse = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=known)
    count = sigma.shape[1]
    coordinates = inverse * (U[:, :, :count].swapaxes(1, 2) @ wrench[..., None])[..., 0]
    free = np.ones(Vt.shape[:2], dtype=bool)
    free[:, :count] = ~known
    basis = (free[..., None] * Vt).swapaxes(1, 2)[:, :, int((~free).sum(axis=1).min()) :]
    tensions = (coordinates[:, None] @ Vt[:, :count])[:, 0]
    tensions += (basis @ (basis.swapaxes(1, 2) @ reference)[..., None])[..., 0]
    missing = np.linalg.norm((structure @ tensions[..., None])[..., 0] - wrench, axis=1)
    rendered = missing <= TOLERANCE * np.maximum(1e-3, np.linalg.norm(wrench, axis=1))
    return Path(tensions, np.ascontiguousarray(basis), bounds), rendered


class Solution(NamedTuple):
    """Tensions (K, m) of a path and the bound of their distance to the optimum, both relative."""

    tensions: Floats
    distance: float


def _longest(path: Path, count: int) -> tuple[Solution | None, int | None, int]:
    """Return the optimum of the longest path that can be rendered, the sample that ends it, and the iterations.

    The samples from ``count`` on are not rendered in any case. A path that can't be rendered can't be so with
    more samples: the first sample in question is found by bisection.
    """
    total, whole = 0, len(path.particular)
    solved, blocked = Solution(path.particular[:0], 0.0), count if count < whole else None
    shortest, longest = 0, count + 1  # lengths that can, and that cannot be rendered
    length = count
    while shortest < longest - 1:
        answer, iterations = _optimum(path.until(length))
        total += iterations
        if isinstance(answer, Solution):
            solved, shortest = answer, length
        elif answer:
            longest, blocked = length, length - 1
        else:
            return None, None, total
        length = (shortest + longest) // 2
    return solved, blocked, total


def _optimum(path: Path) -> tuple[Solution | bool, int]:
    """Return the proved optimum of a path, or whether there is proved to be none, and the number of iterations."""
    z, multipliers, polished_z, polished, iterations = _native.path(path.basis, path.space, path.reach, RELAXATION)
    # The constraints times the multipliers, added up, contradict each other for all z inside the limits.
    slope = np.linalg.norm(path.pull_back(multipliers), axis=1)
    if float((multipliers * (path.space + RELAXATION)).sum() + path.reach @ slope) < 0.0 <= multipliers.min():
        return True, iterations
    # Only where the border leaves no room are the relaxed bounds needed.
    exact = _proved(path, polished_z, polished, path.space)
    return exact or _proved(path, z, multipliers, path.space + RELAXATION) or False, iterations


def _proved(path: Path, z: Floats, multipliers: Floats, space: Floats) -> Solution | None:
    """Return the solution if it is feasible with this space inside each bound, and near the optimum.

    The objective is strongly convex: half the squared distance is at most the duality gap, which is the sum of
    half the squared slope of the Lagrange function and of the products of slack and multipliers.
    """
    slack = space - path.rows(z)
    gap = 0.5 * float(((z + path.pull_back(multipliers)) ** 2).sum()) + float(abs(slack * multipliers).sum())
    distance = math.sqrt(2.0 * gap)
    if float(slack.min()) < -TOLERANCE or distance > TOLERANCE * math.sqrt(slack.size):
        return None
    return Solution(path.particular + (path.basis @ z[..., None])[..., 0], distance)
