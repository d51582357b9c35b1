"""Write a solver: one method, arrays in, tensions out. Its answers are verified like all others."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import tensionlab as tl
from tensionlab.solvers.base import Answer, Problem


@dataclass(frozen=True)
class ClippedMiddle:
    """Tensions closest to the middle of the limits that render the wrench, clipped: quick, and often wrong."""

    policies: ClassVar[tuple[str, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Return tensions (k, m) of a batch of k problems."""
        middle = (problem.lower + problem.upper) / 2
        missing = problem.wrench - np.einsum("knm,km->kn", problem.structure, middle)
        change = np.einsum("kmn,kn->km", np.linalg.pinv(problem.structure), missing)
        tensions = np.clip(middle + change, problem.lower, problem.upper)
        return Answer(tensions, iterations=np.ones(len(tensions), dtype=np.int64))


rig = tl.load_rig("bartels2026-validation")
for force in ([1.0, 0.5, 1.0], [0.0, 4.0, 0.0]):
    print(force, rig.allocate(force, solver=ClippedMiddle()))
