"""How hard do cables pull beside a spring on one of them? It is felt as meant only if the rest is in balance."""

from __future__ import annotations

import numpy as np

from tensionlab.demand import Floats
from tensionlab.solvers.contract import Problem
from tensionlab.solvers.newton import Newton


def pretension(structure: Floats, wrench: Floats, lower: Floats, upper: Floats, reference: Floats) -> Floats:
    """Which tensions (m,), closest to a reference, make a wrench within limits, or come closest to it, in N?

    Parameters
    ----------
    structure : (n, m) array
    wrench : (n,) array
        In N and N·m.
    lower, upper : (m,) arrays
        In N; both 0 where a cable does not take part.
    reference : (m,) array
        In N.
    """
    problem = Problem(
        np.ascontiguousarray(structure)[None],
        np.ascontiguousarray(wrench)[None],
        lower[None],
        upper[None],
        reference[None],
        np.ones(len(wrench)),
        "force",
    )
    tensions: Floats = Newton().solve(problem).tensions[0]
    return tensions
