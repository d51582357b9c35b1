"""The exact solver: dual Newton with an exact line search, compiled, many problems side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.arrays import MAX_MAGNITUDE, Floats
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, TOLERANCE, Answer, Nearest, Problem, Verified


@dataclass(frozen=True)
class Newton:
    """Which tensions within limits render the wrench and are closest to the reference, exactly?

    Minimises ``|t - reference|²/2`` subject to ``W t = w`` and ``lower <= t <= upper`` through its dual, with
    one variable for each of the n wrench components: ``t(y) = clip(reference + W' y, lower, upper)``, where
    y is such that ``W t(y) = w``. Semismooth Newton steps, with a line search along the piecewise quadratic dual
    where a whole step goes astray, end after finitely many. Out of reach, a multiplier soon separates the wrench
    from all that tensions inside the limits render. From it an active set finds the nearest face of what can be
    rendered; where that leaves a doubt, and along a direction, proximal steps solve the policy's own problem to
    the same precision. The whole batch is one call to `tensionlab/native/newton_kernel.cpp`; `newton.hpp` and
    `nearest_face.hpp` beside it state the method. ``TENSIONLAB_NUM_THREADS`` sets the threads.

    References
    ----------
    Qi and Sun (1993), "A nonsmooth version of Newton's method"; Kunisch and Rendl (2003), "An infeasible
    active set method for quadratic problems with simple bounds"; Stark and Parker (1995), "Bounded-variable
    least-squares: an algorithm and applications"; Chiche and Gilbert (2016), "How the augmented Lagrangian
    algorithm can deal with an infeasible convex quadratic optimization problem".
    """

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Nearest, ...]] = ("force", "tension", "direction")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, iterations, separation = _native.newton(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            problem.weights,
            POLICIES.index(problem.nearest or "force"),
            RANK_TOLERANCE,
            TOLERANCE,
        )
        return Answer(tensions, iterations, separation)

    def solve_verified(self, problem: Problem) -> Verified | None:
        """Choose and verify tensions in one pass over the batch (native/bind_allocate.cpp)."""
        found = _native.allocate(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            problem.weights,
            POLICIES.index(problem.nearest or "force"),
            MAX_MAGNITUDE,
            TOLERANCE,
            RANK_TOLERANCE,
        )
        return None if found is None else Verified(*found, {})

    def prepare(
        self, lower: Floats, upper: Floats, reference: Floats, weights: Floats, nearest: Nearest | None
    ) -> _native.Single:
        """Return what solves and verifies one problem with these limits, reference, weights and policy."""
        policy = POLICIES.index(nearest or "force")
        return _native.Single(lower, upper, reference, weights, policy, MAX_MAGNITUDE, TOLERANCE, RANK_TOLERANCE)
