"""Tensions closest to the reference: `Newton`, exact, and `Dykstra`, by alternating projections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE, Policy
from tensionlab.solvers.compiled import CompiledSolver


@dataclass(frozen=True)
class Newton(CompiledSolver):
    """Exact solver: tensions within limits that render the wrench, closest to the reference.

    Minimises ``|t - reference|²/2`` subject to ``W t = w`` and ``lower <= t <= upper`` through its dual, with one
    variable for each of the n wrench components: ``t(y) = clip(reference + W' y, lower, upper)``, where y is such
    that ``W t(y) = w``. Semismooth Newton steps, with a line search along the piecewise quadratic dual where a
    full step fails, end after finitely many. For an infeasible wrench, a multiplier soon separates the wrench from
    all feasible ones. From it an active set finds the nearest face of the feasible set; where that face is in
    doubt, and for the direction policy, proximal steps solve the policy's own problem to the same precision. The
    headers ``newton.hpp`` and ``nearest_face.hpp`` in ``native/solvers`` state the method; ``sweep_kernel.cpp``
    solves most of a batch. ``TENSIONLAB_NUM_THREADS`` sets the threads.

    Sources: Qi and Sun (1993), "A nonsmooth version of Newton's method"; Kunisch and Rendl (2003), "An infeasible
    active set method for quadratic problems with simple bounds"; Stark and Parker (1995), "Bounded-variable
    least-squares: an algorithm and applications"; Chiche and Gilbert (2016), "How the augmented Lagrangian
    algorithm can deal with an infeasible convex quadratic optimization problem".

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.Newton()).tensions.round(3)
    array([1.476, 2.452, 0.5  , 2.042])
    """

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Policy, ...]] = ("force", "tension", "direction")

    def _compiled(self) -> _native.TensionSolver:
        return _native.newton(RANK_TOLERANCE, TOLERANCE)


@dataclass(frozen=True)
class Dykstra(CompiledSolver):
    """Alternating projections: tensions that render the wrench, closest to the reference.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Projects in turn onto the equilibrium
    space {t: W t = w} and onto the limits; the correction p makes the result the *projection* of the start onto
    the intersection, where plain alternating projections only find some point of it::

        y = x - W⁺ (W x - w)      z = clip(y + p)      p = y + p - z      x = z

    The start is the reference; with reference 0 the iterates are those from the pseudo-inverse solution W⁺ w. y +
    p never leaves ``reference + range(W')``, so it is enough to keep n numbers ``pull`` with ``y + p = reference +
    W⁺ pull``, and a whole iteration is ``pull += w - W z``. It also follows that every z is the exact optimum for
    the wrench that it renders itself: stopping early costs equilibrium, never optimality. The whole batch is one
    call to ``tensionlab/native/solvers/dykstra.hpp``, which tests every eighth iteration whether to stop;
    ``TENSIONLAB_NUM_THREADS`` sets the threads.

    For an infeasible wrench, z tends to the point inside the limits that is closest to the equilibrium space, the
    argmin of ``(W t - w)' (W W')⁺ (W t - w)``, while p grows without bound. A part of w outside the range of W is
    ignored.

    Sources: Boyle and Dykstra, "A method for finding projections onto the intersection of convex sets in Hilbert
    spaces", 1986; for cables Hassan and Khajepour, "Analysis of bounded cable tensions in cable-actuated parallel
    manipulators", 2011; the limit where nothing intersects, Bauschke and Borwein, "Dykstra's alternating
    projection algorithm for two sets", 1994.

    Parameters
    ----------
    tolerance : float
        A problem is done when ``|W z - w|`` is at most this times ``max(1, |w|)`` or, if the wrench is infeasible,
        when the duality gap proves z to be within it of the least distance.
    iteration_limit : int
        Iterations after which the last z is returned.
    """

    tolerance: float = 1e-9
    iteration_limit: int = 50_000

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Policy, ...]] = ("tension",)

    def __post_init__(self) -> None:
        if not self.tolerance >= 0 or self.iteration_limit < 1:
            raise InputError(f"{self}: tolerance must not be negative, and iteration_limit at least 1")

    def _compiled(self) -> _native.TensionSolver:
        return _native.dykstra(self.tolerance, self.iteration_limit, RANK_TOLERANCE)
