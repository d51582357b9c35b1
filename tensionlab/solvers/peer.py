"""Other people's solvers, run as they come: one program, once, with no policy and nothing repaired.

`QuadraticProgram` and `ConvexProgram` turn every backend into a solver that keeps the contract, at the price
of more programs. A fair comparison must not charge a backend for that, so it runs peers: the least squared
tensions that render the wrench inside the limits, as anyone would write it down, and what comes back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tensionlab.arrays import Floats


@dataclass(frozen=True)
class Reply:
    """What a peer gave back for one problem; none of it is believed.

    Attributes
    ----------
    tensions : (m,) array or None
        Tensions in N, just as they came, limits broken or not; None if there were none.
    iterations : int
        As the peer counts them; 0 where it does not tell.
    setup_s, solve_s : float
        Its own clock, in seconds; NaN where it does not tell.
    failure : str
        Why there are no tensions.
    """

    tensions: Floats | None
    iterations: int = 0
    setup_s: float = float("nan")
    solve_s: float = float("nan")
    failure: str = ""


class Peer(Protocol):
    """One way to minimise ``|t|²`` subject to ``W t = w`` and limits, in two steps that are timed apart."""

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Put one problem, (n, m), (n,), (m,), (m,), into the form that the peer takes."""
        ...

    def run(self, program: Any) -> Reply:
        """Solve it."""
        ...


def own_tensions(found: Any, cables: int) -> Floats | None:
    """What a backend returned as finite tensions, or None."""
    if found is None or np.shape(found) != (cables,) or not np.isfinite(found).all():
        return None
    return np.array(found, dtype=np.float64)
