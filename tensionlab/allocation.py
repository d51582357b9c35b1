"""Interface of the allocation: `allocate`, `Allocator`, and their result, `Allocation`.

Input is checked and broadcast, the chosen solver chooses, and its answer is verified (`tensionlab.verification`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import InputError, ShapeError, Unreachable
from tensionlab.solvers import SOLVERS, as_fused_solver, make
from tensionlab.solvers.base import (
    POLICIES,
    RANK_TOLERANCE,
    TOLERANCE,
    Policy,
    Problem,
    Solver,
    Status,
    Verified,
    refusal,
    resolve_policy,
)
from tensionlab.support import provenance
from tensionlab.support.arrays import (
    Floats,
    Integers,
    Limits,
    as_numeric,
    broadcast_last_axis,
    check,
    check_size,
    common_axes,
    flatten_batch,
    readonly_copy,
    require_finite,
    tension_limits,
)
from tensionlab.support.formatting import format_number, format_range, format_share, format_vector
from tensionlab.support.table import STATUS_MARKS, Column, Table
from tensionlab.verification import verify

if TYPE_CHECKING:
    import pandas
    import xarray


__all__ = [
    "POLICIES",
    "RANK_TOLERANCE",
    "TOLERANCE",
    "Allocation",
    "Allocator",
    "Policy",
    "Solver",
    "Status",
    "allocate",
]


@dataclass  # not frozen: to set eleven fields of a frozen class takes longer than to solve
class Allocation:
    """Tensions of an allocation, with the proof of each.

    The leading axes are those that structure, wrench, limits and reference broadcast to.

    Attributes
    ----------
    tensions : (..., m) array
        Cable tensions in N, always inside the limits; NaN where the status is FAILED.
    wrench : (..., n) array
        Rendered wrench, ``structure @ tensions``.
    residual : (...,) array
        Weighted error, ``sqrt(sum(weights * (desired - wrench)**2))``. EXACT is verified without the weights.
    status : (...,) array of `Status`
        Verified, never the solver's claim. EXACT promises tensions inside their limits and a wrench error of at
        most ``1e-6 max(1, |w|)``. A wrench w that is infeasible by less than that is EXACT too (policies "force"
        and "direction"): the tensions are those of a feasible wrench within that distance. Choosing another such
        wrench changes the tensions by at most that distance over the smallest singular value of the free
        cables' columns of W. A feasible wrench is rendered to rounding, 1e-12 of the total pull.
    scale : (...,) array
        1 where EXACT; for the direction policy the largest s with ``W t = s w``; NaN elsewhere, and where no s
        from 0 to 1 keeps the direction. For w within 0.00001 rad of a facet, or a flat rig, ``s w`` counts as
        rendered within ``1e-6 max(1, |w|)`` (nine tenths of that towards s = 0), so that s falls gradually as
        w leaves the facet.
    iterations : (...,) array
        Number of iterations, as the solver counts them.
    separation : (..., n) array
        Where NEAREST, a direction d that certifies the wrench infeasible: ``d·w`` exceeds ``d·W t`` for all
        tensions t inside the limits. Zeros elsewhere.
    failures : mapping
        Reason for each FAILED answer, by flat index.
    modules : tuple of str
        Names of the cables' modules; empty unless a rig allocated (`Rig.allocate`).
    desired : (..., n) array or None
        Desired wrench; None unless a rig allocated.
    position : (..., d) array or None
        Position of the reference point in m; None unless a rig allocated.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tug_of_war = [[1.0, -1.0]]  # two cables pull against each other, with 1 N to 5 N each
    >>> result = tl.allocate(tug_of_war, [[2.0], [7.0]], (1.0, 5.0))
    >>> result.tensions
    array([[3., 1.],
           [5., 1.]])
    >>> result.residual
    array([0., 3.])
    >>> result.status == tl.Status.EXACT
    array([ True, False])
    """

    tensions: Floats
    wrench: Floats
    residual: Floats
    status: NDArray[np.int8]
    scale: Floats
    iterations: Integers
    separation: Floats
    failures: Mapping[int, str] = field(default_factory=dict)
    modules: tuple[str, ...] = ()
    desired: Floats | None = None
    position: Floats | None = None

    @property
    def exact(self) -> NDArray[np.bool_]:
        """Whether the desired wrench is rendered (...): the status is EXACT."""
        return np.equal(self.status, Status.EXACT)

    @property
    def infeasible(self) -> NDArray[np.bool_]:
        """Whether no tensions inside the limits render the desired wrench (...): `separation` certifies it."""
        return np.equal(self.status, Status.NEAREST)

    def counts(self) -> dict[Status, int]:
        """Return how many answers have each status.

        Examples
        --------
        >>> import tensionlab as tl
        >>> tug_of_war = [[1.0, -1.0]]  # two cables pull against each other, with 1 N to 5 N each
        >>> counts = tl.allocate(tug_of_war, [[2.0], [7.0]], (1.0, 5.0)).counts()
        >>> counts[tl.Status.NEAREST]
        1
        """
        return {status: int(np.count_nonzero(self.status == status)) for status in Status}

    def __repr__(self) -> str:
        return f"<{self}>" if self.status.ndim else f"<Allocation {self}>"

    def __str__(self) -> str:
        counts = ", ".join(f"{count} {status.name}" for status, count in self.counts().items() if count)
        if self.status.ndim:
            largest = f"; largest residual {np.nanmax(self.residual):.3g}" if self.status.size else ""
            return f"Allocation of {self.status.size} wrenches: {counts or 'none'}{largest}"
        with np.printoptions(precision=6, suppress=True, linewidth=1000):
            wrench = self.wrench.round(6) + 0.0  # not -0
            return (
                f"{Status(int(self.status)).name}: tensions {self.tensions} N render the wrench {wrench}, "
                f"residual {self.residual:.3g}"
            )

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return the tensions of one allocation, or the counts of statuses of several."""
        if not self.status.ndim:
            note = f"renders {format_vector(self.wrench)}, with an error of {format_number(float(self.residual))}"
            tensions = zip(self._cables(), self.tensions, strict=True)
            mark = STATUS_MARKS[int(self.status)]
            return Table(["cable", Column("tension", "N")], tensions, mark, [note, *self.failures.values()])
        rows = []
        for status, count in self.counts().items():
            if count:
                part = self.status == status
                largest = [float(np.max(array[part])) for array in (self.residual, self.iterations)]
                rows.append([status, count, count / part.size, largest[0], round(largest[1])])
        shape = " x ".join(map(str, self.status.shape))
        title = f"{shape} wrenches, {self.tensions.shape[-1]} cables"
        columns = ["status", "wrenches", Column("share", format=format_share),
                   Column("largest residual", format=".3g"), "most iterations"]  # fmt: skip
        return Table(columns, rows, title)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a data frame with a row for each wrench, indexed by the leading axes.

        The columns are ``status``, ``residual``, ``scale``, ``iterations``, ``tension_0`` ... in N (named by
        module where a rig allocated), ``wrench_0`` ... in N and N·m, and where a rig allocated ``desired_0`` ...
        and ``position_0`` ... in m. MissingDependency if pandas is not installed.
        """
        columns: dict[str, Any] = {"status": np.array([status.name for status in Status])[self.status.ravel()]}
        columns |= {name: np.ravel(getattr(self, name)) for name in ("residual", "scale", "iterations")}
        columns |= {f"tension_{cable}": self.tensions[..., j].ravel() for j, cable in enumerate(self._cables())}
        for name, array in (("wrench", self.wrench), ("desired", self.desired), ("position", self.position)):
            if array is not None:
                whole = np.broadcast_to(array, (*self.status.shape, array.shape[-1]))
                columns |= {f"{name}_{i}": whole[..., i].ravel() for i in range(array.shape[-1])}
        frame = provenance.data_frame(columns)
        if self.status.ndim > 1:
            axes = np.indices(self.status.shape).reshape(self.status.ndim, -1)
            frame = frame.set_index([*axes]).rename_axis([f"axis_{i}" for i in range(len(axes))])
        return frame

    def _cables(self) -> Sequence[str]:
        """Return the names of the modules, or the numbers of the cables where there is no rig."""
        return self.modules or [str(cable) for cable in range(self.tensions.shape[-1])]

    def to_xarray(self) -> xarray.Dataset:
        """Return the arrays as a dataset, with named dimensions and units.

        The dimensions are ``axis_0`` and so on, ``cable`` and ``component``. MissingDependency if xarray is not
        installed.
        """
        leading = [f"axis_{i}" for i in range(self.status.ndim)]
        last = {"tensions": ["cable"], "wrench": ["component"], "separation": ["component"]}
        units = {"tensions": "N", "wrench": "N and N m", "residual": "N"}
        names = ("tensions", "wrench", "residual", "status", "scale", "iterations", "separation")
        dataset: xarray.Dataset = provenance.import_xarray().Dataset({
            name: ([*leading, *last.get(name, [])], getattr(self, name), {"units": units.get(name, "1")})
            for name in names
        })  # fmt: skip
        return dataset

    def raise_for_status(self) -> Allocation:
        """Return the allocation if every status is EXACT; `Unreachable`, which carries it, if any is not.

        Examples
        --------
        >>> import tensionlab as tl
        >>> tug_of_war = [[1.0, -1.0]]  # two cables pull against each other, with 1 N to 5 N each
        >>> tl.allocate(tug_of_war, [2.0], (1.0, 5.0)).raise_for_status().tensions
        array([3., 1.])
        >>> tl.allocate(tug_of_war, [7.0], (1.0, 5.0)).raise_for_status()
        Traceback (most recent call last):
            ...
        tensionlab.errors.Unreachable: 1 of 1 wrenches are not rendered exactly (1 NEAREST); the largest error is 3
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


# Allocates for one structure matrix and wrench; None where these are not of the plainest kind.
_Single = Callable[[object, object], Allocation | None]


def _leave(structure: object, wrench: object) -> Allocation | None:
    """Leave a problem to the way that batches go."""
    return None


@dataclass(frozen=True)
class _Prepared:
    """Constant part of all problems of one size, m cables and n wrench components."""

    lower: Floats
    upper: Floats
    reference: Floats
    weights: Floats
    single: _Single


def resolve_solver(solver: str | Solver, policy: Policy | None) -> tuple[Solver, Policy | None]:
    """Return the solver given by name or as an instance, and its policy.

    Parameters and errors as those of `allocate`.
    """
    if isinstance(solver, type):
        raise InputError(f"solver is the class {solver.__name__}; give an instance, {solver.__name__}()")
    if not isinstance(solver, str) and not hasattr(solver, "policies"):
        raise InputError(f"solver is {solver!r:.60}; give a name in tensionlab.SOLVERS or an instance of a solver")
    if policy is not None and not isinstance(policy, str):
        raise InputError(f"policy is {policy!r:.60}; give one of {', '.join(map(repr, POLICIES))}")
    made: Solver = make(solver) if isinstance(solver, str) else solver
    return made, resolve_policy(made, policy, type(made).__name__)


class Allocator:
    """Prepared allocation for many calls with the same limits and solver.

    The parameters are those of `allocate`, checked once. Call it with a structure matrix and a wrench. Threads
    may share it, with problems of any sizes.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> allocator = tl.Allocator(rig.limits, reference="middle")
    >>> allocator(rig.structure_matrix(rig.home), [0.0, 0.0, 1.5]).tensions.round(3)
    array([2.899, 3.875, 1.923, 4.011])
    """

    def __init__(
        self,
        limits: Limits | tuple[ArrayLike, ArrayLike],
        solver: str | Solver = "newton",
        reference: ArrayLike | Literal["lower", "middle"] | None = None,
        policy: Policy | None = None,
        wrench_weights: ArrayLike | None = None,
    ) -> None:
        self.solver, self.policy = resolve_solver(solver, policy)
        self._fused = as_fused_solver(self.solver)
        self.lower, self.upper = tension_limits(limits)
        self.reference = self._resolve(reference)
        self.weights = _weights(wrench_weights)
        self._prepared: dict[tuple[int, int], _Prepared] = {}
        self._single: _Single = _leave  # for problems of the last one's size

    def __repr__(self) -> str:
        policy = f", nearest in {self.policy}" if self.policy else ""
        limits = f"limits {format_range(self.lower, self.upper)} N"
        return f"<Allocator {self.solver}{policy}, {limits}, reference {format_range(self.reference)} N>"

    def _resolve(self, reference: ArrayLike | None) -> Floats:
        if reference is None:
            return readonly_copy(np.zeros(1))
        if isinstance(reference, str):
            if reference == "lower":
                return self.lower
            if reference == "middle":
                return readonly_copy((self.lower + self.upper) / 2)
            raise InputError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
        return readonly_copy(require_finite("reference", reference, 0))

    def __call__(self, structure: ArrayLike, wrench: ArrayLike) -> Allocation:
        """Choose tensions for these structure matrices (..., n, m) and wrenches (..., n)."""
        allocation = self._single(structure, wrench)
        return self._solve(structure, wrench) if allocation is None else allocation

    def _solve(self, structure: ArrayLike, wrench: ArrayLike) -> Allocation:
        """Solve a batch, or a problem of another size than the last one."""
        if type(structure) is np.ndarray and structure.ndim == 2:
            self._single = single = (self._prepared.get(structure.shape) or self._prepare(*structure.shape)).single
            allocation = single(structure, wrench)
            if allocation is not None:
                return allocation
        matrices, vectors = as_numeric("structure", structure, 2), as_numeric("wrench", wrench, 1)
        problem, shape = self.problem(matrices, vectors)
        verified = self._fused.solve_verified(problem) if self._fused else None
        if verified is None:
            check("structure", matrices)
            check("wrench", vectors)
            verified = verify(problem, self.solver.solve(problem))
        return _shaped(verified, shape)

    def problem(self, structure: Floats, wrench: Floats) -> tuple[Problem, tuple[int, ...]]:
        """Return the problems of a call as one batch, and the leading axes of its answer."""
        n, m = structure.shape[-2:]
        if wrench.shape[-1] != n:
            raise ShapeError(
                f"wrench has {wrench.shape[-1]} components where structure {structure.shape} has {n} rows"
            )
        fixed = self._prepared.get((n, m)) or self._prepare(n, m)
        shape = common_axes(
            {
                "structure": structure.shape[:-2],
                "wrench": wrench.shape[:-1],
                "lower": fixed.lower.shape[:-1],
                "upper": fixed.upper.shape[:-1],
                "reference": fixed.reference.shape[:-1],
            }
        )
        return Problem(
            structure=flatten_batch(structure, shape, 2),
            wrench=flatten_batch(wrench, shape, 1),
            lower=flatten_batch(fixed.lower, shape, 1),
            upper=flatten_batch(fixed.upper, shape, 1),
            reference=flatten_batch(fixed.reference, shape, 1),
            weights=fixed.weights,
            policy=self.policy,
        ), shape

    def _prepare(self, n: int, m: int) -> _Prepared:
        """Spread limits, reference and weights over m cables and n components, and keep them for the next call."""
        check_size(n, m)
        if reason := refusal(self.solver, n, m):
            able = ", ".join(name for name in SOLVERS if not refusal(make(name), n, m))
            name = type(self.solver).__name__
            raise InputError(f"{name} does not support this problem: {reason}; these do: {able}")

        lower = broadcast_last_axis("lower", self.lower, m, "cables")
        upper = broadcast_last_axis("upper", self.upper, m, "cables")
        reference = broadcast_last_axis("reference", self.reference, m, "cables")
        weights = broadcast_last_axis("wrench_weights", self.weights, n, "rows")
        single: _Single = _leave
        if self._fused and lower.ndim == upper.ndim == reference.ndim == 1:
            single = self._fused.prepare(lower, upper, reference, weights, self.policy, Allocation)
        # Threads may share an allocator: what one has prepared is never changed, only found or not.
        prepared = self._prepared[n, m] = _Prepared(lower, upper, reference, weights, single)
        return prepared


def allocate(
    structure: ArrayLike,
    wrench: ArrayLike,
    limits: Limits | tuple[ArrayLike, ArrayLike],
    solver: str | Solver = "newton",
    reference: ArrayLike | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> Allocation:
    """Return cable tensions inside their limits that render the wrench, with a verified status.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices; ``structure @ tensions`` is the wrench on the platform.
    wrench : (..., n) array
        Desired wrenches, N and N·m. All leading axes broadcast.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    solver : str or Solver
        Name in `tensionlab.SOLVERS` (``"qp:osqp"`` picks a variant), or an instance.
    reference : (..., m) array, "lower", "middle" or None
        Tensions to stay close to. None: zero, which gives the least sum of squares.
    policy : {"force", "tension", "direction"} or None
        Substitute for an infeasible wrench: the closest wrench; the wrench of the tensions closest to
        equilibrium, in the metric ``(W W')^+``; or the longest wrench in the desired direction (the closest
        wrench where no wrench in that direction is feasible). None: the solver's default.
    wrench_weights : (n,) array or None
        Positive weights of the components in every wrench error, for wrenches that mix N and N·m.

    Returns
    -------
    Allocation

    Raises
    ------
    ShapeError
        If an array has NaN, infinity or the wrong shape, or a lower limit exceeds an upper one.
    UnknownSolver
        If no solver has that name.
    InputError
        If ``solver`` is not a solver, does not support the policy, or does not support problems of this size.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)  # (3, 4)
    >>> result = tl.allocate(structure, [1.0, 0.5, 1.0], rig.limits)
    >>> result.tensions.round(3)
    array([2.278, 1.801, 0.5  , 2.611])
    >>> forces = [[1.0, 0.5, 1.0], [20.0, 0.0, 0.0]]  # the second is infeasible
    >>> tl.allocate(structure, forces, rig.limits, policy="direction").scale.round(3)
    array([1.   , 0.244])
    """
    if isinstance(solver, str) and wrench_weights is None and (single := _unprepared(solver)):
        allocation = single(structure, wrench, limits, reference, policy)
        if allocation is not None:
            return allocation
    return Allocator(limits, solver, reference, policy, wrench_weights)(structure, wrench)


@lru_cache(maxsize=64)
def _unprepared(name: str) -> Callable[..., Allocation | None] | None:
    """Return what a built-in solver does without an `Allocator`, whose checks take longer than one problem."""
    fused = as_fused_solver(make(name)) if name.partition(":")[0] in SOLVERS else None
    return None if fused is None else fused.unprepared(Allocation)


def _shaped(verified: Verified, shape: tuple[int, ...]) -> Allocation:
    """Return an allocation with the given leading axes; where there are none, numbers are NumPy scalars."""
    tensions, wrench, residual, status, scale, iterations, separation, failures = verified
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


def _weights(weights: ArrayLike | None) -> Floats:
    """Return positive wrench weights; one that stands for all where none are given."""
    if weights is None:
        return readonly_copy(np.ones(1))
    values = require_finite("wrench_weights", weights, 1)
    if values.ndim != 1 or not (values > 0).all():
        raise ShapeError(
            f"wrench_weights must be positive numbers, one for each wrench component; got {values!s:.60}"
        )
    return readonly_copy(values)
