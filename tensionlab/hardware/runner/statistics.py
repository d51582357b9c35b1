"""What happens in a cycle of a run, and counts and times over all of them."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tensionlab.allocation import Allocation, Status
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


KEPT = 100_000
"""Cycles whose times are kept for percentiles."""
STATUSES = tuple(sorted(Status))
PERCENTILES = (50.0, 99.0, 100.0)


@dataclass
class Statistics:
    """Counts and times of a run.

    Attributes
    ----------
    cycles : int
        How many there were.
    missed : int
        Deadlines that no cycle began at, because one before them was still going on.
    replaced : int
        Cycles in which the exact solver gave the answer.
    slewed : int
        Cycles whose set-points went only a part of the way, by the limit on their change.
    statuses : Counter of Status
        Of the allocations sent.
    late_telemetry : Counter of str
        Cycles in which a module's latest telemetry was more than two of its periods old, by module.
    derated : dict of str to float
        Modules whose upper tension limit was lowered because their winding got warm, and the lowest, in N.
    lost : dict of str to str
        Modules that dropped out, and why.
    ended : str
        What ended the run.
    emergency : bool
        Whether that was an emergency stop from elsewhere.
    unconfirmed : dict of str to str
        Modules that did not confirm the stop at the end, and why.
    late, work : deque of float
        Time from deadline to begin of the latest cycles, and what the host needed for each, in s.
    """

    cycles: int = 0
    missed: int = 0
    replaced: int = 0
    slewed: int = 0
    statuses: Counter[Status] = field(default_factory=Counter)
    late_telemetry: Counter[str] = field(default_factory=Counter)
    derated: dict[str, float] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)
    ended: str = ""
    emergency: bool = False
    unconfirmed: dict[str, str] = field(default_factory=dict)
    late: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    work: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))

    def take(self, cycle: Cycle, *, slewed: bool) -> None:
        """Count a cycle."""
        self.cycles += 1
        self.replaced += cycle.replaced
        self.slewed += slewed
        self.statuses[STATUSES[int(cycle.allocation.status)]] += 1
        self.late.append(cycle.late)
        self.work.append(cycle.work)

    def percentiles(self) -> dict[str, tuple[float, ...]]:
        """Median, 99th percentile and largest of `late` and `work`, in s; zeros before the first cycle."""
        return {
            name: tuple(float(value) for value in np.percentile(list(times) or [0.0], PERCENTILES))
            for name, times in (("late", self.late), ("work", self.work))
        }

    def summary(self) -> dict[str, Any]:
        """The same as plain numbers and texts; times in s."""
        named = ("median", "p99", "largest")
        times = {name: dict(zip(named, values, strict=True)) for name, values in self.percentiles().items()}
        return {
            "ended": self.ended,
            "emergency": self.emergency,
            "cycles": self.cycles,
            "missed": self.missed,
            "replaced": self.replaced,
            "slewed": self.slewed,
            "statuses": {status.name: self.statuses[status] for status in Status},
            "late_telemetry": dict(self.late_telemetry),
            "derated": self.derated,
            "lost": self.lost,
            "unconfirmed": self.unconfirmed,
            **times,
        }
