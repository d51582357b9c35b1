"""What happens in one cycle of a run?"""

from __future__ import annotations

from dataclasses import dataclass

from tensionlab.allocation import Allocation
from tensionlab.arrays import Floats, Integers
from tensionlab.demand import Demand, RigState


@dataclass(frozen=True, eq=False)
class Cycle:
    """What happened in one cycle of a run?

    Attributes
    ----------
    state : RigState
        At its begin.
    demand : Demand
        What was asked for.
    asked : (n,) array
        What of it the solver was asked for: all but what modules with an impedance pull.
    allocation : Allocation
        What the solver chose, measured; with tension 0 in modules that do not take part.
    replaced : bool
        Whether the run's own solver left the answer unproved, so that the exact solver gave this one.
    sent : (m,) array
        Set-points in N, after the limit on their change; NaN where none was sent.
    sequences : (m,) array of int
        Their sequence numbers; -1 where none was sent.
    late : float
        How long after its deadline the cycle began, in s.
    work : float
        What the host needed for it, in s.
    """

    state: RigState
    demand: Demand
    asked: Floats
    allocation: Allocation
    replaced: bool
    sent: Floats
    sequences: Integers
    late: float
    work: float
