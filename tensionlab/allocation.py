"""The interface: which tensions render this wrench, and what is proved about them?

`allocate` checks and broadcasts its input, lets the chosen solver choose, and then measures the answer
itself (`tensionlab.verification`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.arrays import (
    LARGEST,
    Floats,
    Limits,
    check,
    check_size,
    common_axes,
    finite,
    frozen,
    numbers,
    rows,
    spread,
    tension_limits,
)
from tensionlab.errors import ShapeError
from tensionlab.solvers import SOLVERS, make
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, TOLERANCE, Nearest, Problem, Solver, Status, refusal
from tensionlab.solvers.newton import Newton
from tensionlab.verification import Allocation, exact, exact_single, measure

__all__ = [
    "POLICIES",
    "RANK_TOLERANCE",
    "TOLERANCE",
    "Allocation",
    "Allocator",
    "Nearest",
    "Solver",
    "Status",
    "allocate",
]


@dataclass(frozen=True)
class _Prepared:
    """What an allocator knows about problems of one size: m cables and n wrench components."""

    lower: Floats
    upper: Floats
    reference: Floats
    weights: Floats
    single: _native.Single | None


class Allocator:
    """Tension allocation with limits and a solver that stay the same.

    Parameters are those of `allocate`; what does not change is checked once. Call it with a structure matrix
    and a wrench. Threads may share it, with problems of any sizes.
    """

    def __init__(
        self,
        limits: Limits | tuple[ArrayLike, ArrayLike],
        solver: str | Solver = "newton",
        reference: ArrayLike | Literal["lower", "middle"] | None = None,
        nearest: Nearest | None = None,
        wrench_weights: ArrayLike | None = None,
    ) -> None:
        if isinstance(solver, type):
            raise TypeError(f"solver is the class {solver.__name__}; give an instance, {solver.__name__}()")
        if not isinstance(solver, str) and not hasattr(solver, "policies"):
            raise TypeError(
                f"solver is {solver!r:.60}; give a name in tensionlab.SOLVERS or an instance of a solver"
            )
        self.solver: Solver = make(solver) if isinstance(solver, str) else solver
        self.nearest = _policy(self.solver, nearest)
        self.lower, self.upper = tension_limits(limits)
        self.reference = self._resolve(reference)
        self.weights = _weights(wrench_weights)
        self._prepared: dict[tuple[int, ...], _Prepared] = {}

    def _resolve(self, reference: ArrayLike | None) -> Floats:
        if reference is None:
            return frozen(np.zeros(1))
        if isinstance(reference, str):
            if reference == "lower":
                return self.lower
            if reference == "middle":
                return frozen((self.lower + self.upper) / 2)
            raise ValueError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
        return frozen(finite("reference", reference, 0))

    def __call__(self, structure: ArrayLike, wrench: ArrayLike) -> Allocation:
        """Choose tensions for these structure matrices (..., n, m) and wrenches (..., n)."""
        if type(structure) is np.ndarray and type(wrench) is np.ndarray and structure.ndim == 2:
            single = (self._prepared.get(structure.shape) or self._prepare(*structure.shape)).single
            found = None if single is None else exact_single(single, structure, wrench)
            if found is not None:
                return found
        matrices, vectors = numbers("structure", structure, 2), numbers("wrench", wrench, 1)
        problem, shape = self._problem(matrices, vectors)
        if isinstance(self.solver, Newton):
            found = exact(problem, shape, LARGEST)
            if found is not None:
                return found
        check("structure", matrices)
        check("wrench", vectors)
        return measure(problem, self.solver.solve(problem), shape)

    def _problem(self, structure: Floats, wrench: Floats) -> tuple[Problem, tuple[int, ...]]:
        n, m = structure.shape[-2:]
        if wrench.shape[-1] != n:
            raise ShapeError(
                f"wrench has {wrench.shape[-1]} components where structure {structure.shape} has {n} rows"
            )
        fixed = self._prepared.get((n, m)) or self._prepare(n, m)
        shape = common_axes(
            structure=structure.shape[:-2],
            wrench=wrench.shape[:-1],
            lower=fixed.lower.shape[:-1],
            upper=fixed.upper.shape[:-1],
            reference=fixed.reference.shape[:-1],
        )
        return Problem(
            structure=rows(structure, shape, 2),
            wrench=rows(wrench, shape, 1),
            lower=rows(fixed.lower, shape, 1),
            upper=rows(fixed.upper, shape, 1),
            reference=rows(fixed.reference, shape, 1),
            weights=fixed.weights,
            nearest=self.nearest,
        ), shape

    def _prepare(self, n: int, m: int) -> _Prepared:
        """Spread limits, reference and weights over m cables and n components, and keep them for the next call."""
        check_size(n, m)
        if reason := refusal(self.solver, n, m):
            able = ", ".join(name for name in SOLVERS if not refusal(make(name), n, m))
            raise ValueError(f"{type(self.solver).__name__} serves no such problem: {reason}; these do: {able}")

        lower = spread("lower", self.lower, m, "cables")
        upper = spread("upper", self.upper, m, "cables")
        reference = spread("reference", self.reference, m, "cables")
        weights = spread("wrench_weights", self.weights, n, "rows")
        single = None
        if isinstance(self.solver, Newton) and lower.ndim == upper.ndim == reference.ndim == 1:
            policy = POLICIES.index(self.nearest or "force")
            single = _native.Single(lower, upper, reference, weights, policy, LARGEST, TOLERANCE, RANK_TOLERANCE)
        # Threads may share an allocator: what one has prepared is never changed, only found or not.
        prepared = self._prepared[n, m] = _Prepared(lower, upper, reference, weights, single)
        return prepared


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
        What to render where the wrench is out of reach: the closest wrench; the tensions closest to
        equilibrium, in the metric ``(W W')^+``; or the longest wrench in the desired direction, and the
        closest wrench where none of that direction can be rendered. None: the solver's own.
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
        If the solver cannot honour the policy, or serves no problems of this size.
    """
    return Allocator(limits, solver, reference, nearest, wrench_weights)(structure, wrench)


def _weights(weights: ArrayLike | None) -> Floats:
    """Wrench weights, positive; one that stands for all where none are given."""
    if weights is None:
        return frozen(np.ones(1))
    values = finite("wrench_weights", weights, 1)
    if values.ndim != 1 or not (values > 0).all():
        raise ShapeError(
            f"wrench_weights must be positive numbers, one for each wrench component; got {values!s:.60}"
        )
    return frozen(values)


def _policy(solver: Solver, nearest: Nearest | None) -> Nearest | None:
    name = type(solver).__name__
    if nearest is None:
        return solver.policies[0] if solver.policies else None
    if not isinstance(nearest, str):
        raise TypeError(f"nearest is {nearest!r:.60}; give one of {', '.join(map(repr, POLICIES))}")
    if nearest in solver.policies:
        return nearest
    honoured = ", ".join(repr(policy) for policy in solver.policies)
    raise ValueError(
        f"{name} cannot honour nearest={nearest!r}; "
        + (f"it honours {honoured}" if honoured else "it promises no best substitute, so leave nearest out")
    )
