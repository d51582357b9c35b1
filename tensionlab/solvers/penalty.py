"""Solvers with penalties: `AnalyticCentre`, `SlackNorm` and `Spidar`."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import ClassVar

import numpy as np

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.solvers.compiled import CompiledSolver


@dataclass(frozen=True)
class AnalyticCentre(CompiledSolver):
    """Analytic centre: tensions clear of all limits, with the largest product of distances to them.

    Maximises ``sum ln(t - lower) + sum ln(upper - t)`` subject to ``W t = w``. There is one answer for every
    wrench inside the workspace, it is a smooth function of wrench and pose, and no tension touches a limit. Cables
    with equal limits, and the reference, play no part.

    A multiplier y of the wrench components fixes each tension: with c the middle of its limits, h half their
    range and q = h W_i'y it is ``c + h q / (1 + sqrt(1 + q²))``. Newton steps with a line search raise the dual,
    which is self-concordant, in those n variables; no feasible start is needed
    (``native/solvers/dual_ascent.hpp``).

    The wrench error s is penalised, ``s = P (1 + P |y|²) y`` with P = 1e-14, in units of the largest (weighted)
    change of the wrench that half the range of one cable makes. At a distance d from the edge of the workspace,
    where k cables would be at their limits, it is k P / d: a hundredth of a unit away 1e-11 units at most, 1e-6
    units away 1e-7, and at the very edge 5e-7, which is still EXACT on rigs of a few newton. Beyond, the tensions
    tend to their limits and the wrench to the one of least error: near the best that can be rendered, and not
    proved to be.

    Sources: Sonnevend, "An analytical centre for polyhedrons and new classes of global algorithms for linear
    (smooth, convex) programming", 1985; Nesterov and Nemirovskii, "Interior-Point Polynomial Algorithms in Convex
    Programming", 1994, for the steps. On a cable robot: "Experimental validation of the analytic-centre based
    tension distribution algorithm for cable driven parallel robots", 2025.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.AnalyticCentre()).tensions.round(3)
    array([2.942, 3.918, 1.966, 4.069])
    """

    objective: ClassVar[str] = "largest product of distances to the limits"

    def _compiled(self) -> _native.TensionSolver:
        return _native.log_barrier()


@dataclass(frozen=True)
class SlackNorm(CompiledSolver):
    """P-norm with slack: tensions close to the reference and clear of their limits, with penalised wrench error.

    Minimises ``sum |(t - t0)/h|^p - c1 sum ln((t - lower)/h) - c2 sum ln((upper - t)/h) + kappa sum(
    sqrt(s² + epsilon) + gamma s²)`` over the tensions t and the slack s, where ``W t + unit s / sqrt(weights) =
    w``. t0 is the reference, h is half the range of each cable, and the unit is the largest (weighted) change of
    the wrench that half the range of one cable makes: all parameters are pure numbers, and a stronger rig gives
    stronger answers. Cables with equal limits play no part.

    The tensions are strictly inside their limits for every wrench, feasible or not, and a continuously
    differentiable function of wrench and pose. The cost is a bias: towards the middle by c1 and c2, and in the
    wrench. With y the slope of the other prices, the slack is ``sqrt(epsilon) y / kappa`` as long as y is well
    below kappa: about 1e-8 units and never 1e-6, which is EXACT, until the wrench is within 1e-3 units of the edge
    of the workspace. Nearer than about ``m c / kappa`` units, for m cables, a wrench error is accepted: some 1e-4
    units at the edge. Beyond, the answer is no best substitute; as kappa grows it tends to the tensions whose
    error has the least 1-norm.

    Solved through its dual of n variables by line-searched Newton steps, which converge from anywhere
    (``native/solvers/dual_ascent.hpp``); the source solves the same conditions by Newton steps on all variables
    at once.

    Source: Ueland, Sauder and Skjetne, "Optimal force allocation for overconstrained cable-driven parallel
    robots: continuously differentiable solutions with assessment of computational efficiency", 2021.

    Parameters
    ----------
    p : float
        Exponent of the distance to the reference, 2 or more. Larger ones weigh the largest distance.
    c1, c2 : float
        Penalties of coming close to the lower and to the upper limits, positive; 0.1 as in the authors' examples.
    kappa : float
        Penalty of slack, positive. 3500 is what the authors' 200 / N makes with their half range of 17.5 N.
    epsilon : float
        Square of the slack below which its penalty is smooth, positive. This project's: the authors' 1e-3 N², 3e-6
        here, leaves an error of about 1e-5 N everywhere, which is never EXACT.
    gamma : float
        Quadratic part of the penalty of slack, positive; 0.0875 is the authors' 0.005 / N.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.SlackNorm(p=3.0)).tensions.round(3)
    array([1.525, 2.501, 0.549, 2.109])
    """

    p: float = 2.0
    c1: float = 0.1
    c2: float = 0.1
    kappa: float = 3500.0
    epsilon: float = 1e-14
    gamma: float = 0.0875

    objective: ClassVar[str] = (
        "least p-norm of the change from the reference, with log barriers and penalised slack"
    )

    def __post_init__(self) -> None:
        for field in fields(self):
            lowest = 2.0 if field.name == "p" else np.finfo(float).tiny
            value = getattr(self, field.name)
            if not lowest <= value < np.inf:
                wanted = "2 or more" if field.name == "p" else "positive"
                raise InputError(f"SlackNorm({field.name}={value}): must be finite and {wanted}")

    def _compiled(self) -> _native.TensionSolver:
        return _native.slack_norm(*astuple(self))


@dataclass(frozen=True)
class Spidar(CompiledSolver):
    """SPIDAR's program: least wrench error plus a little squared change of tension, within limits.

    Minimises ``force |f - F t|² + torque |q - M t|² + mu |t - reference|²`` on the limits, exactly: f and F are
    the force rows of wrench and structure matrix, q and M the torque rows. With the usual reference 0 this is
    Springhead's program for its SPIDAR haptic devices. A problem knows no units; the number of rows tells their
    kinds: up to three rows are all force, as for a point; of four to six the first three are force and the
    others torque. On a planar platform, with its torque in row three, ``wrench_weights`` set the balance: they
    multiply both prices row by row.

    There is an answer for every wrench and it is continuous, but inside the workspace it does not render the
    wrench: the error is ``(mu / price) y``, with y the multiplier of the wrench, which for one cable is its
    tension. With the default mu that is of the order of 1e-3 of the tensions over the number of cables that share
    the load: far more than `TOLERANCE`, so the status is UNPROVEN nearly everywhere. For an infeasible
    wrench it is as close to the "force" policy's answer. Smaller mu come closer to both.

    Solved through its dual of n variables, ``t = clip(reference + W'y)``, by semismooth Newton steps with a line
    search, which end after finitely many (``native/solvers/dual_ascent.hpp``).

    Source: Hasegawa and the Springhead developers, "Springhead", HumanInterface/HISpidarCalc, 2003-2008; for the
    device, Kim, Hasegawa, Koike and Sato, "Tension based 7-DOF force feedback device: SPIDAR-G", 2002.

    Parameters
    ----------
    mu : float
        Penalty of a squared tension, 1/N², positive.
    force, torque : float
        Penalties of a squared error, in 1/N² and 1/(N·m)², positive.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.Spidar(mu=1e-3)).tensions.round(3)
    array([1.469, 2.444, 0.5  , 2.033])
    """

    mu: float = 1e-3
    force: float = 1.0
    torque: float = 0.3

    objective: ClassVar[str] = "least squared wrench error plus mu times the squared change from the reference"

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise InputError(f"Spidar({field.name}={value}): must be positive and finite")

    def _compiled(self) -> _native.TensionSolver:
        return _native.box_price(self.mu, self.force, self.torque)
