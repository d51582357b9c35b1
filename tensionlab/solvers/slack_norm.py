"""The p-norm with slack: smooth tensions that give way gently where the wrench is out of reach."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from tensionlab import _native
from tensionlab.solvers.base import Answer, Nearest, Problem


@dataclass(frozen=True)
class SlackNorm:
    """Which tensions are close to the reference, clear of their limits, and miss no more wrench than they must?

    Minimises ``sum |(t - t0)/h|^p - c1 sum ln((t - lower)/h) - c2 sum ln((upper - t)/h) + kappa sum(
    sqrt(s² + epsilon) + gamma s²)`` over the tensions t and the slack s, where ``W t + unit s / sqrt(weights) =
    w``. t0 is the reference, h is half the range of each cable, and the unit is the largest (weighted) change of
    the wrench that half the range of one cable makes: all parameters are pure numbers, and a stronger rig gives
    stronger answers. Cables without play keep their tension and take no part.

    The tensions are strictly inside their limits for every wrench, reachable or not, and a continuously
    differentiable function of wrench and pose. That is bought with bias: towards the middle by c1 and c2, and in
    the wrench. With y the slope of the other prices, the slack is ``sqrt(epsilon) y / kappa`` as long as y is well
    below kappa: about 1e-8 units and never 1e-6, which is EXACT, until the wrench is within 1e-3 units of the edge
    of the workspace. Nearer than about ``m c / kappa`` units, for m cables, wrench is given away instead: some
    1e-4 units at the edge. Beyond, the answer is no best substitute; as kappa grows it tends to the tensions
    whose error has the least 1-norm.

    Solved through its dual of n variables by Newton steps with a line search (`native/dual_ascent.hpp`), which
    converge from anywhere; the source solves the same conditions by Newton steps on all variables at once.

    Source: Ueland, Sauder and Skjetne, "Optimal force allocation for overconstrained cable-driven parallel
    robots: continuously differentiable solutions with assessment of computational efficiency", 2021.

    Parameters
    ----------
    p : float
        Exponent of the distance to the reference, 2 or more. Larger ones weigh the largest distance.
    c1, c2 : float
        Prices of coming close to the lower and to the upper limits, positive; 0.1 as in the authors' examples.
    kappa : float
        Price of slack, positive. 3500 is what the authors' 200 / N makes with their half range of 17.5 N.
    epsilon : float
        Square of the slack below which its price is round, positive. Ours: the authors' 1e-3 N², 3e-6 here,
        leaves an error of about 1e-5 N everywhere, which is never EXACT.
    gamma : float
        How much faster than the slack its price grows, positive; 0.0875 is the authors' 0.005 / N.
    """

    p: float = 2.0
    c1: float = 0.1
    c2: float = 0.1
    kappa: float = 3500.0
    epsilon: float = 1e-14
    gamma: float = 0.0875

    objective: ClassVar[str] = "least p-norm of the change from the reference, with log barriers and priced slack"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            least = 2.0 if field.name == "p" else np.finfo(float).tiny
            value = getattr(self, field.name)
            if not least <= value < np.inf:
                wanted = "2 or more" if field.name == "p" else "positive"
                raise ValueError(f"SlackNorm({field.name}={value}): must be finite and {wanted}")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, iterations = _native.slack_norm(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            problem.weights,
            self.p,
            self.c1,
            self.c2,
            self.kappa,
            self.epsilon,
            self.gamma,
        )
        return Answer(tensions, iterations)
