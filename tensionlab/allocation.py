"""The interface: which tensions render this wrench, and what is proved about them?

`allocate` checks and broadcasts its input, lets the chosen solver choose, and then measures the answer itself:
tensions are clipped into their limits, the wrench is recomputed, and every status rests on that measure and, for
NEAREST, on a direction that separates the wrench from all that the cables can render.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import ShapeError, Unreachable
from tensionlab.solvers import make
from tensionlab.solvers.contract import (
    POLICIES,
    RANK_TOLERANCE,
    TOLERANCE,
    Answer,
    Floats,
    Integers,
    Nearest,
    Problem,
    Solver,
    Status,
)
from tensionlab.solvers.newton import Newton


class Limits(Protocol):
    """Anything with tension limits, as `tensionlab.TensionLimits`."""

    @property
    def lower(self) -> Floats:
        """Least tensions, (..., m), N."""

    @property
    def upper(self) -> Floats:
        """Largest tensions, (..., m), N."""


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
        ``sqrt(sum(weights * (asked - wrench)**2))``.
    status : (...,) array of `Status`
        Measured, never the backend's claim.
    scale : (...,) array
        1 where EXACT; the largest s with ``W t = s w`` for the direction policy; NaN elsewhere.
    iterations : (...,) array
        As the solver counts them.
    separation : (..., n) array
        Where NEAREST, a direction d that proves the wrench out of reach: ``d·w`` exceeds the largest ``d·W t``
        of all tensions inside the limits. Zeros elsewhere.
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
        where = "" if self.status.ndim == 0 else f" at index {np.unravel_index(worst, self.status.shape)}"
        where = where.replace("np.int64(", "").replace("),", ",").replace("))", ")")
        reason = self.failures.get(worst)
        raise Unreachable(
            f"{flawed.size} of {self.status.size} wrenches are not rendered exactly ({counts}); the largest error is "
            f"{self.residual.ravel()[worst]:.6g}{where}" + (f": {reason}" if reason else ""),
            self,
        )


class Allocator:
    """Which tensions render each wrench, asked again and again with the same limits and solver?

    Parameters are those of `allocate`; what does not change is checked once. Call it with a structure matrix and
    a wrench.
    """

    def __init__(
        self,
        limits: Limits | tuple[ArrayLike, ArrayLike],
        solver: str | Solver = "newton",
        reference: ArrayLike | Literal["lower", "middle"] | None = None,
        nearest: Nearest | None = None,
        wrench_weights: ArrayLike | None = None,
    ) -> None:
        self.solver: Solver = make(solver) if isinstance(solver, str) else solver
        self.nearest = _policy(self.solver, nearest)
        pair = limits if isinstance(limits, tuple) else (limits.lower, limits.upper)
        if len(pair) != 2:
            raise ShapeError(f"limits must be (lower, upper), got {len(pair)} entries")
        self.lower, self.upper = (
            _finite(name, array, 0) for name, array in zip(("lower", "upper"), pair, strict=True)
        )
        crossed = np.argwhere(self.lower > self.upper)
        if crossed.size:
            index = tuple(int(i) for i in crossed[0])
            low, high = (
                np.broadcast_to(a, np.broadcast(self.lower, self.upper).shape)
                for a in (self.lower, self.upper)
            )
            raise ShapeError(
                f"lower[{index}] = {low[index]:g} N exceeds upper[{index}] = {high[index]:g} N; swap them"
            )
        self.reference = self._reference(reference)
        self.weights = None if wrench_weights is None else _finite("wrench_weights", wrench_weights, 1)
        if self.weights is not None and not (self.weights.ndim == 1 and (self.weights > 0).all()):
            raise ShapeError("wrench_weights must be positive numbers, one for each wrench component")

    def _reference(self, reference: ArrayLike | None) -> Floats:
        if reference is None:
            return np.zeros(1)
        if isinstance(reference, str):
            if reference == "lower":
                return self.lower
            if reference == "middle":
                return (self.lower + self.upper) / 2
            raise ValueError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
        return _finite("reference", reference, 0)

    def __call__(self, structure: ArrayLike, wrench: ArrayLike) -> Allocation:
        """Choose tensions for these structure matrices (..., n, m) and wrenches (..., n)."""
        problem, shape = self._problem(_finite("structure", structure, 2), _finite("wrench", wrench, 1))
        return measure(problem, self.solver.solve(problem), shape)

    def _problem(self, structure: Floats, wrench: Floats) -> tuple[Problem, tuple[int, ...]]:
        n, m = structure.shape[-2:]
        if not (1 <= n <= _native.MAX_COMPONENTS and 1 <= m <= _native.MAX_CABLES):
            raise ShapeError(
                f"structure has {n} wrench components and {m} cables; it must have 1 to {_native.MAX_COMPONENTS} "
                f"and 1 to {_native.MAX_CABLES}"
            )
        if wrench.shape[-1] != n:
            raise ShapeError(
                f"wrench has {wrench.shape[-1]} components where structure {structure.shape} has {n} rows"
            )
        weights = np.ones(n) if self.weights is None else self.weights
        if weights.shape != (n,):
            raise ShapeError(f"wrench_weights has {weights.size} entries where structure has {n} rows")
        named = {"lower": self.lower, "upper": self.upper, "reference": self.reference}
        for name, array in named.items():
            if array.ndim and array.shape[-1] not in (1, m):
                raise ShapeError(f"{name} has {array.shape[-1]} entries where structure has {m} cables")
        leading = {"structure": structure.shape[:-2], "wrench": wrench.shape[:-1]}
        leading |= {name: array.shape[:-1] for name, array in named.items()}
        try:
            shape = np.broadcast_shapes(*leading.values())
        except ValueError:
            shapes = ", ".join(f"{name} {axes}" for name, axes in leading.items() if axes)
            raise ShapeError(f"the leading axes do not broadcast together: {shapes}") from None
        rows = {name: _rows(array, shape, (m,)) for name, array in named.items()}
        return Problem(
            structure=_rows(structure, shape, (n, m)),
            wrench=_rows(wrench, shape, (n,)),
            **rows,
            weights=weights,
            nearest=self.nearest,
        ), shape


def allocate(
    structure: ArrayLike,
    wrench: ArrayLike,
    limits: Limits | tuple[ArrayLike, ArrayLike],
    solver: str | Solver = "newton",
    reference: ArrayLike | Literal["lower", "middle"] | None = None,
    nearest: Nearest | None = None,
    wrench_weights: ArrayLike | None = None,
) -> Allocation:
    """Which cable tensions inside their limits render the wrench, and closest to the reference?

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices; ``structure @ tensions`` is the wrench on the platform.
    wrench : (..., n) array
        Desired wrenches, N and N·m. All leading axes broadcast.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    solver : str or Solver
        A name in `tensionlab.SOLVERS` (``"qp:osqp"`` picks a variant), or an instance.
    reference : (..., m) array, "lower", "middle" or None
        Tensions to stay close to; None is zero, which gives the least sum of squares.
    nearest : {"force", "tension", "direction"} or None
        What to render where the wrench is out of reach: the closest wrench; the tensions closest to equilibrium,
        in the metric ``(W W')^+``; or the longest wrench in the desired direction. None: the solver's own.
    wrench_weights : (n,) array or None
        Positive weights of the components in every wrench error; for mixed N and N·m.

    Returns
    -------
    Allocation

    Raises
    ------
    ShapeError
        If an array has NaN, infinity or the wrong shape, or a lower limit exceeds an upper one.
    UnknownSolver
        If no solver has that name.
    ValueError
        If the solver cannot honour the policy.
    """
    return Allocator(limits, solver, reference, nearest, wrench_weights)(structure, wrench)


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
    tensions = np.require(answer.tensions, np.float64, ["C", "W"])
    if tensions.shape != (size, m):
        raise ShapeError(f"the solver returned tensions of shape {tensions.shape}, not {(size, m)}")
    if answer.separation is None:
        separation = np.zeros((size, n))
    else:
        separation = np.nan_to_num(answer.separation, posinf=0.0, neginf=0.0)
    wrench, residual, status, scale = _judge(problem, tensions, separation)
    open_ = np.flatnonzero(status == Status.ITERATION_LIMIT)
    if problem.nearest == "direction" and answer.separation is None and open_.size:
        # The longest wrench needs a direction that no error vector supplies: ask the exact solver for one.
        part = _take(problem, open_)
        proposal = Newton().solve(part).separation
        found = tensions[open_]
        wrench[open_], residual[open_], status[open_], scale[open_] = _judge(part, found, proposal)
        separation[open_] = proposal
    failed = np.flatnonzero(status == Status.FAILED)
    reasons = {int(row): answer.failures.get(int(row), "the solver returned NaN") for row in failed}
    return Allocation(
        tensions=tensions.reshape(*shape, m),
        wrench=wrench.reshape(*shape, n),
        residual=residual.reshape(shape),
        status=status.reshape(shape),
        scale=scale.reshape(shape),
        iterations=np.asarray(answer.iterations, dtype=np.int64).reshape(shape),
        separation=separation.reshape(*shape, n),
        failures=reasons,
    )


def _judge(problem: Problem, tensions: Floats, separation: Any) -> tuple[Any, Any, Any, Any]:
    """Clip the tensions in place, measure them, and leave in ``separation`` what is proved (native/judge.hpp)."""
    rule = 0 if problem.nearest is None else 1 + POLICIES.index(problem.nearest)
    wrench, residual, status, scale = _native.judge(
        problem.structure,
        problem.wrench,
        problem.lower,
        problem.upper,
        problem.weights,
        tensions,
        separation,
        rule,
        TOLERANCE,
        RANK_TOLERANCE,
    )
    return wrench, residual, status, scale


def _take(problem: Problem, rows: NDArray[np.intp]) -> Problem:
    return replace(
        problem,
        structure=problem.structure[rows],
        wrench=problem.wrench[rows],
        lower=problem.lower[rows],
        upper=problem.upper[rows],
        reference=problem.reference[rows],
    )


def _policy(solver: Solver, nearest: Nearest | None) -> Nearest | None:
    name = type(solver).__name__
    if nearest is None:
        return solver.policies[0] if solver.policies else None
    if nearest in solver.policies:
        return nearest
    honoured = ", ".join(repr(policy) for policy in solver.policies)
    raise ValueError(
        f"{name} cannot honour nearest={nearest!r}; "
        + (f"it honours {honoured}" if honoured else "it promises no best substitute, so leave nearest out")
    )


def _finite(name: str, array: ArrayLike, axes: int) -> Floats:
    """The array as contiguous floats with at least so many axes, or an error that names the entry."""
    try:
        values: Floats = np.asarray(array, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} is not an array of numbers: {error}") from None
    if values.ndim < axes:
        raise ShapeError(f"{name} needs at least {axes} axes, got shape {values.shape}")
    if not np.isfinite(values).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ShapeError(f"{where} is {values[index]}; every entry must be a finite number")
    return values


def _rows(array: Floats, shape: tuple[int, ...], inner: tuple[int, ...]) -> Floats:
    """The array broadcast to all problems and flattened to one leading axis; a read-only view where possible."""
    full = np.broadcast_to(array, shape + inner)
    rows = full.reshape((int(np.prod(shape)), *inner))
    if rows.size and rows.strides[1:] != np.empty(inner).strides:
        rows = np.ascontiguousarray(rows)
    rows.flags.writeable = False
    return rows
