"""Contract of the solvers: the problem they are given, the answer they return, and what they promise.

A solver is a frozen dataclass of its hyper-parameters with one method, ``solve``. It sees a batch that has
already been checked and flattened, so it never validates; it returns tensions, and never a status, because
`tensionlab.verification` certifies every answer. `CONTRIBUTING.md` shows one from start to end, and how
another distribution brings its own, through the entry point group ``tensionlab.solvers``.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.support.arrays import Floats, Integers

Policy = Literal["force", "tension", "direction"]
POLICIES: tuple[Policy, ...] = get_args(Policy)

# Largest error of a proved answer, in newton. EXACT: of the wrench, times max(1, its norm). NEAREST: of the
# distance that remains, times max(1, norm of what is rendered).
TOLERANCE = 1e-6

# Cosine between a wrench w and the normal of a face of the available wrench set, below which w counts as parallel
# to the face: there the direction policy counts `s w` as rendered where tensions come within `TOLERANCE` of it.
GRAZING = 1e-5

RANK_TOLERANCE = 1e-8  # singular values of a structure matrix below this share of its largest one count as zero


class Status(enum.IntEnum):
    """Status of an answer, proved by measuring it."""

    EXACT = 0
    """The tensions are inside their limits and render the wrench within tolerance."""
    NEAREST = 1
    """A separating direction certifies the wrench infeasible; the answer is the policy's best."""
    UNPROVEN = 2
    """Unproven: the solver stopped early, or it promises no best substitute."""
    FAILED = 3
    """The backend failed; `Allocation.failures` has the reason."""


@dataclass(frozen=True)
class Problem:
    """Batch of B problems: minimise ``|t - reference|²/2`` subject to ``W t = w`` and limits.

    Every array is float64 and finite, with ``lower <= upper``. Arrays may be read-only and broadcast over the
    first axis; the other axes are contiguous.

    Attributes
    ----------
    structure : (B, n, m) array
        Structure matrices W, for n wrench components and m cables.
    wrench : (B, n) array
        Desired wrenches w, in N (and N·m).
    lower, upper, reference : (B, m) arrays
        Tension limits and the tensions to stay close to, in N.
    weights : (n,) array
        Positive weights of the wrench components; the error of an answer is ``sqrt(sum(weights * r**2))``.
    policy : {"force", "tension", "direction"} or None
        What to do where w is infeasible. None only for solvers without policies.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.solvers import Newton, Problem
    >>> one = np.ones((1, 2))
    >>> problem = Problem(
    ...     structure=np.array([[[1.0, -1.0]]]),
    ...     wrench=np.array([[2.0]]),
    ...     lower=one,
    ...     upper=5.0 * one,
    ...     reference=0.0 * one,
    ...     weights=np.ones(1),
    ...     policy="force",
    ... )
    >>> Newton().solve(problem).tensions
    array([[3., 1.]])
    """

    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    reference: Floats
    weights: Floats
    policy: Policy | None

    def __len__(self) -> int:
        return len(self.structure)

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """Structure, wrench, lower, upper, reference and weights, in the order of the compiled kernels."""
        return self.structure, self.wrench, self.lower, self.upper, self.reference, self.weights

    def take(self, rows: NDArray[np.intp]) -> Problem:
        """Return the problems of these rows, in arrays of their own."""
        structure, wrench, lower, upper, reference = (array[rows] for array in self.arrays[:5])
        return Problem(structure, wrench, lower, upper, reference, self.weights, self.policy)


@dataclass(frozen=True)
class Answer:
    """Answer of a solver for a batch of B problems.

    Attributes
    ----------
    tensions : (B, m) array
        Tensions in N; a row of NaN where the backend failed.
    iterations : (B,) array
        Iterations spent, as the solver counts them; 0 for closed forms.
    separation : (B, n) array or None
        A direction d for each problem that may certify it infeasible: ``d·w`` exceeds the largest ``d·W t`` inside
        the limits. Zeros where there is none. It is always checked; if left out, one is derived from the answer.
    failures : dict
        Reason by row, for rows where the backend failed.
    """

    tensions: Floats
    iterations: Integers
    separation: Floats | None = None
    failures: dict[int, str] = field(default_factory=dict)


class Verified(NamedTuple):
    """Answers for a batch of B problems with what is proved about each, as in `tensionlab.Allocation`."""

    tensions: Floats
    wrench: Floats
    residual: Floats
    status: NDArray[np.int8]
    scale: Floats
    iterations: Integers
    separation: Floats
    failures: Mapping[int, str]


class Solver(Protocol):
    """Interface of a solver: it chooses tensions for a batch of problems.

    A solver that does not support every size also has a method ``refuses(n, m)``, which `refusal` calls.

    Examples
    --------
    >>> import tensionlab as tl
    >>> solver: tl.Solver = tl.solvers.Newton()
    >>> solver.objective, solver.policies
    ('least squared change from the reference', ('force', 'tension', 'direction'))
    """

    @property
    def objective(self) -> str:
        """What it minimises among the tensions that render the wrench, in a few words."""

    policies: ClassVar[tuple[Policy, ...]]
    """Policies that it supports, its default first; empty if it promises no best substitute."""

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""


def resolve_policy(solver: Solver, policy: str | None, name: str) -> Policy | None:
    """Return a policy that the solver supports: the given one or its default; None if it supports none.

    InputError, calling the solver by ``name``, if it does not support the policy.
    """
    if policy is None:
        return solver.policies[0] if solver.policies else None
    for supported in solver.policies:
        if supported == policy:
            return supported
    own = ", ".join(map(repr, solver.policies))
    raise InputError(
        f"{name} does not support policy={policy!r}; "
        + (f"it supports {own}" if own else "it promises no best substitute, so leave policy out")
    )


def refusal(solver: Solver, n: int, m: int) -> str | None:
    """Return why a solver does not support problems with n wrench components and m cables; None if it does.

    `allocate` then raises, and a comparison leaves the solver out with that reason.
    """
    refuses: Callable[[int, int], str | None] | None = getattr(solver, "refuses", None)
    return None if refuses is None else refuses(n, m)
