"""What was chosen and what is proved about it: the measure behind every status.

Whoever chose the tensions, they are clipped into their limits, the wrench is recomputed, and a verdict needs
a certificate that anyone can check (`tensionlab/native/judge.hpp`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.arrays import Floats, Integers
from tensionlab.errors import ShapeError, Unreachable
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, TOLERANCE, Answer, Problem, Status
from tensionlab.solvers.newton import Newton


@dataclass(frozen=True)
class Allocation:
    """Which tensions were chosen, and what is proved about them?

    Leading axes are those that structure, wrench, limits and reference broadcast to.

    Attributes
    ----------
    tensions : (..., m) array
        In N, always inside the limits; NaN where the status is FAILED.
    wrench : (..., n) array
        What those tensions render: ``structure @ tensions``.
    residual : (...,) array
        ``sqrt(sum(weights * (desired - wrench)**2))``. EXACT is judged without the weights.
    status : (...,) array of `Status`
        Verified, never the backend's claim. EXACT promises tensions inside their limits and an error of the
        wrench w of at most ``1e-6 max(1, |w|)``: a wrench that is out of reach by less is EXACT too, whatever
        the policy if that is force or direction. The tensions are then those of a wrench so near, and no
        closer to the reference than theirs may be; by how much another wrench so near would change them is the
        error over the least singular value of the free cables' columns of W. A wrench within reach is rendered
        to rounding: 1e-12 of what the cables pull with, at most.
    scale : (...,) array
        1 where EXACT; the largest s with ``W t = s w`` for the direction policy; NaN elsewhere, and where no s
        from 0 to 1 keeps the direction. Where w is within 0.00001 rad of a face of what can be rendered, or the
        rig is flat there, ``s w`` counts as rendered within ``1e-6 max(1, |w|)`` of it (nine tenths of that
        towards s = 0): s then falls gradually as w leaves the face.
    iterations : (...,) array
        As the solver counts them.
    separation : (..., n) array
        Where NEAREST, a direction d that proves the wrench out of reach: ``d·w`` exceeds the largest
        ``d·W t`` of all tensions inside the limits. Zeros elsewhere.
    failures : mapping
        Reason by flat index, where FAILED.
    """

    tensions: Floats
    wrench: Floats
    residual: Floats
    status: NDArray[np.int8]
    scale: Floats
    iterations: Integers
    separation: Floats
    failures: Mapping[int, str] = field(default_factory=dict)

    def counts(self) -> dict[Status, int]:
        """How many answers have each status?"""
        return {status: int(np.count_nonzero(self.status == status)) for status in Status}

    def __str__(self) -> str:
        counts = ", ".join(f"{count} {status.name}" for status, count in self.counts().items() if count)
        if self.status.ndim:
            largest = f"; largest residual {np.nanmax(self.residual):.3g}" if self.status.size else ""
            return f"Allocation of {self.status.size} wrenches: {counts or 'none'}{largest}"
        with np.printoptions(precision=6, suppress=True):
            return (
                f"{Status(int(self.status)).name}: tensions {self.tensions} N render the wrench {self.wrench}, "
                f"residual {self.residual:.3g}"
            )

    def raise_for_status(self) -> Allocation:
        """Return the allocation if every wrench is rendered exactly, or raise.

        Raises
        ------
        Unreachable
            If any status is not EXACT. The error carries this allocation.
        """
        flawed = np.flatnonzero(self.status != Status.EXACT)
        if not flawed.size:
            return self
        worst = int(flawed[np.argmax(np.nan_to_num(self.residual.ravel()[flawed], nan=np.inf))])
        counts = ", ".join(
            f"{count} {status.name}"
            for status, count in self.counts().items()
            if count and status is not Status.EXACT
        )
        index = ", ".join(str(int(i)) for i in np.unravel_index(worst, self.status.shape))
        where = f" at index [{index}]" if index else ""
        reason = self.failures.get(worst)
        raise Unreachable(
            f"{flawed.size} of {self.status.size} wrenches are not rendered exactly ({counts}); "
            f"the largest error is {self.residual.ravel()[worst]:.6g}{where}" + (f": {reason}" if reason else ""),
            self,
        )


def measure(problem: Problem, answer: Answer, shape: tuple[int, ...]) -> Allocation:
    """What is proved about a solver's answer?

    Parameters
    ----------
    problem : Problem
        A batch of B problems.
    answer : Answer
        What a solver returned for it; nothing in it is believed.
    shape : tuple of int
        Leading axes of the result, B entries in all.
    """
    size, n, m = problem.structure.shape
    tensions = _own(answer.tensions)
    if tensions.shape != (size, m):
        raise ShapeError(f"the solver returned tensions of shape {tensions.shape}, not {(size, m)}")
    proposed = answer.separation is not None
    separation = _own(answer.separation) if answer.separation is not None else np.zeros((size, n))
    wrench, residual, status, scale, flawed = _judge(problem, tensions, separation)
    failures: dict[int, str] = {}
    if flawed:
        unproved = np.flatnonzero(status == Status.ITERATION_LIMIT)
        if problem.nearest == "direction" and not proposed and unproved.size:
            # That proof needs a direction that no error vector supplies: ask the exact solver for one.
            part, found = problem.take(unproved), tensions[unproved]
            proof = _own(Newton().solve(part).separation)
            _, _, status[unproved], scale[unproved], _ = _judge(part, found, proof)
            separation[unproved] = proof
        failed = map(int, np.flatnonzero(status == Status.FAILED))
        failures = {row: answer.failures.get(row, "the solver returned NaN") for row in failed}
    iterations = np.asarray(answer.iterations, dtype=np.int64)
    return _shaped(shape, tensions, wrench, residual, status, scale, iterations, separation, failures)


def exact(problem: Problem, shape: tuple[int, ...], largest: float) -> Allocation | None:
    """What does `Newton` choose, and what is proved about it?

    The same as `measure` of its answer, in one pass over the batch (native/bind_allocate.cpp). None if an entry of
    a structure matrix or a wrench is not a number below ``largest``.
    """
    found = _native.allocate(
        problem.structure,
        problem.wrench,
        problem.lower,
        problem.upper,
        problem.reference,
        problem.weights,
        POLICIES.index(problem.nearest or "force"),
        largest,
        TOLERANCE,
        RANK_TOLERANCE,
    )
    return None if found is None else _shaped(shape, *found, {})


_STATUSES = tuple(np.int8(status) for status in sorted(Status))


def exact_single(solve: _native.Single, structure: Floats, wrench: object) -> Allocation | None:
    """The same for one problem, prepared; None if the arguments are not two plain arrays of the right shapes."""
    n, m = structure.shape
    numbers = np.empty(m + 2 * n + 2)
    found = solve(structure, wrench, numbers)
    if found is None:
        return None
    allocation = object.__new__(Allocation)
    # All at once: one by one, as the initialiser of a frozen class sets them, takes longer than solving.
    vars(allocation).update(
        tensions=numbers[:m],
        wrench=numbers[m : m + n],
        residual=numbers[-2],
        status=_STATUSES[found[0]],
        scale=numbers[-1],
        iterations=np.int64(found[1]),
        separation=numbers[m + n : -2],
        failures={},
    )
    return allocation


def _shaped(
    shape: tuple[int, ...],
    tensions: Floats,
    wrench: Floats,
    residual: Floats,
    status: NDArray[np.int8],
    scale: Floats,
    iterations: Integers,
    separation: Floats,
    failures: Mapping[int, str],
) -> Allocation:
    """An allocation with the leading axes asked for; where there are none, numbers are NumPy scalars."""
    return Allocation(
        tensions=tensions.reshape(*shape, tensions.shape[1]),
        wrench=wrench.reshape(*shape, wrench.shape[1]),
        residual=residual.reshape(shape)[()],
        status=status.reshape(shape)[()],
        scale=scale.reshape(shape)[()],
        iterations=iterations.reshape(shape)[()],
        separation=separation.reshape(*shape, separation.shape[1]),
        failures=failures,
    )


def _own(array: Floats | None) -> Floats:
    """An array that the judge may write to: the solver's own, or a copy of one that is not writable."""
    return np.require(array, np.float64, ("C_CONTIGUOUS", "WRITEABLE"))


def _judge(
    problem: Problem, tensions: Floats, separation: Floats
) -> tuple[Floats, Floats, NDArray[np.int8], Floats, bool]:
    """Clip the tensions in place, measure them, and leave in ``separation`` the proof (native/judge.hpp)."""
    return _native.judge(
        problem.structure,
        problem.wrench,
        problem.lower,
        problem.upper,
        problem.weights,
        tensions,
        separation,
        0 if problem.nearest is None else 1 + POLICIES.index(problem.nearest),
        TOLERANCE,
        RANK_TOLERANCE,
    )
