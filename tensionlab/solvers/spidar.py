"""SPIDAR's program: a little wrench error is traded for less tension, on the box of the limits."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from tensionlab import _native
from tensionlab.solvers.base import Answer, Nearest, Problem


@dataclass(frozen=True)
class Spidar:
    """Which tensions within limits have the least wrench error plus a little squared change of tension?

    Minimises ``force |f - F t|² + torque |q - M t|² + mu |t - reference|²`` on the limits, exactly: f and F are
    the force rows of wrench and structure matrix, q and M the torque rows. With the usual reference 0 this is
    Springhead's program for its SPIDAR haptic devices. A problem knows no units, so rows are told apart by their
    number: up to three rows are all force, as for a point; of four to six the first three are force and the
    others torque. On a planar platform, with its torque in row three, ``wrench_weights`` set the balance: they
    multiply both prices row by row.

    There is an answer for every wrench and it is continuous, but inside the workspace it doesn't render the
    wrench: the error is ``(mu / price) y``, with y the multiplier of the wrench, which for one cable is its
    tension. With the default mu that is of the order of 1e-3 of the tensions over the number of cables that share
    the load: far more than `TOLERANCE`, so the status is ITERATION_LIMIT nearly everywhere. Out of reach it is
    as close to the "force" policy's answer. Smaller mu come closer to both.

    Solved through its dual of n variables, ``t = clip(reference + W'y)``, by semismooth Newton steps with a line
    search, which end after finitely many (`native/dual_ascent.hpp`).

    Source: Hasegawa and the Springhead developers, "Springhead", HumanInterface/HISpidarCalc, 2003-2008; for the
    device, Kim, Hasegawa, Koike and Sato, "Tension based 7-DOF force feedback device: SPIDAR-G", 2002.

    Parameters
    ----------
    mu : float
        Price of a squared tension, 1/N², positive.
    force, torque : float
        Prices of a squared error, in 1/N² and 1/(N·m)², positive.
    """

    mu: float = 1e-3
    force: float = 1.0
    torque: float = 0.3

    objective: ClassVar[str] = "least squared wrench error plus mu times the squared change from the reference"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise ValueError(f"Spidar({field.name}={value}): must be positive and finite")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        rows = np.arange(len(problem.weights))
        prices = np.where(rows < 3, self.force, self.torque) * problem.weights
        tensions, iterations = _native.box_price(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            np.sqrt(prices / self.mu),
        )
        return Answer(tensions, iterations)
