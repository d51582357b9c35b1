"""Derivatives of the tensions that the exact solver chooses, by what they are chosen for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.allocation import Allocation, Allocator
from tensionlab.errors import InputError, ShapeError
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, Policy, Problem, Solver
from tensionlab.solvers.least_squares import Newton
from tensionlab.support.arrays import Floats, Limits, as_numeric, flatten_batch, require_finite


class AllocationGradients(NamedTuple):
    """Gradients of a scalar with respect to the arguments of an allocation.

    The leading axes are those of the allocation; where an argument had fewer, sum over the others.

    Attributes
    ----------
    structure : (..., n, m) array
    wrench : (..., n) array
    lower, upper : (..., m) arrays
        Gradients with respect to the tension limits; zero where the cable is not at the limit.
    reference : (..., m) array
        Zero where the wrench is infeasible, since the reference then has no influence.

    Examples
    --------
    >>> import tensionlab as tl
    >>> jacobian = tl.allocation_jacobian([[1.0, -1.0]], [2.0], (1.0, 5.0))  # the second cable is at 1 N
    >>> gradients = jacobian.pull_back([1.0, 0.0])  # of the first cable's tension
    >>> gradients.wrench, gradients.lower
    (array([1.]), array([0., 1.]))
    """

    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    reference: Floats


@dataclass(frozen=True)
class AllocationJacobian:
    """Derivatives of the tensions of an `allocation` with respect to its arguments, each computed when first used.

    While no cable reaches or leaves a limit, the tensions are a smooth function, and these are its derivatives.
    They do not exist at a *kink*: where a cable is just at its limit without a force that holds it there, or the
    free cables do not determine the tensions. The arrays are then computed with every cable at a limit held there:
    a one-sided derivative if a single cable is in doubt, else merely finite.

    Notes
    -----
    With F the free cables and W⁺ the pseudo-inverse of their columns, ``dt_F = W⁺ (dw - dW t) + (1 - W⁺ W_F)
    dW_F' y`` where the wrench is rendered, y being its multiplier. *Infeasible wrenches*, among the concepts, says
    what the policies minimise elsewhere; all are differentiated in the same way, ``direction`` with its scale
    (``native/solvers/allocation_jacobian.hpp``).

    Sources: Amos and Kolter (2017), "OptNet: differentiable optimization as a layer in neural networks"; Golub and
    Pereyra (1973), "The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
    separate".
    """

    allocation: Allocation
    _problem: Problem
    _shape: tuple[int, ...]

    @cached_property
    def wrench(self) -> Floats:
        """Derivatives d tensions / d wrench, (..., m, n)."""
        return self._shaped(self._without_structure[0])

    @cached_property
    def structure(self) -> Floats:
        """Derivatives d tensions / d structure, (..., m, n, m); `pull_back` needs no such array."""
        by_structure = _native.allocation_jacobian(*self._given(True))[1]
        assert by_structure is not None
        return self._shaped(by_structure)

    @cached_property
    def kink(self) -> NDArray[np.bool_]:
        """Whether the tensions have no derivative there, (...,)."""
        return self._without_structure[2].reshape(self._shape)[()]

    def pull_back(self, cotangent: ArrayLike) -> AllocationGradients:
        """Return the gradients of a scalar whose gradient with respect to the tensions is ``cotangent``, (..., m).

        These are the vector-Jacobian products of reverse-mode differentiation. ShapeError if the cotangent is not
        finite, or does not broadcast to the tensions.
        """
        given, tensions = require_finite("cotangent", cotangent, 1), self.allocation.tensions
        try:
            spread = np.broadcast_to(given, tensions.shape)
        except ValueError:
            raise ShapeError(f"cotangent has shape {given.shape}, not the tensions' {tensions.shape}") from None
        flat = flatten_batch(spread, self._shape, 1)
        return AllocationGradients(*map(self._shaped, _native.allocation_gradients(*self._given(flat))))

    @cached_property
    def _without_structure(self) -> tuple[Floats, Floats | None, NDArray[np.bool_]]:
        return _native.allocation_jacobian(*self._given(False))

    def _given(self, last: object) -> tuple[Any, ...]:
        """Return the arguments of the compiled kernels."""
        allocation, size = self.allocation, len(self._problem)
        return (
            self._problem.arrays,
            (
                allocation.tensions.reshape(size, allocation.tensions.shape[-1]),
                np.reshape(allocation.scale, size),
                np.reshape(allocation.status, size),
            ),
            POLICIES.index(self._problem.policy or "force"),
            RANK_TOLERANCE,
            last,
        )

    def _shaped(self, array: Floats) -> Floats:
        return array.reshape(*self._shape, *array.shape[1:])


def allocation_jacobian(
    structure: ArrayLike,
    wrench: ArrayLike,
    limits: Limits | tuple[ArrayLike, ArrayLike],
    solver: str | Solver = "newton",
    reference: ArrayLike | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> AllocationJacobian:
    """Choose tensions, as `allocate` does, and return them with their derivatives.

    Parameters are the same as those of `allocate`. All its policies are supported, with weights and reference; of
    the solvers only ``"newton"`` is, whose answers show exactly which cables are at a limit.

    Raises
    ------
    InputError, ShapeError
        If the solver is another one, and as `allocate`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tug_of_war = [[1.0, -1.0]]  # two cables pull against each other, with 1 N to 5 N each
    >>> jacobian = tl.allocation_jacobian(tug_of_war, [[2.0], [4.0], [7.0]], (1.0, 5.0))
    >>> jacobian.wrench[:, 0, 0]  # d first tension / d wrench: feasible, at the edge, infeasible
    array([1., 0., 0.])
    >>> jacobian.kink
    array([False,  True, False])
    """
    allocator = Allocator(limits, solver, reference, policy, wrench_weights)
    if type(allocator.solver) is not Newton:
        raise InputError(
            f"solver is {solver!r:.60}, which minimises {allocator.solver.objective!r}; allocation_jacobian "
            f"differentiates the answers of 'newton' alone ({Newton.objective}): leave solver out"
        )
    allocation = allocator(structure, wrench)
    problem, shape = allocator.problem(as_numeric("structure", structure, 2), as_numeric("wrench", wrench, 1))
    return AllocationJacobian(allocation, problem, shape)
