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
    solver_wrench : (n,) array
        What of it the solver was asked for: all but what modules with an impedance pull.
    allocation : Allocation
        What the solver chose, measured; with tension 0 in modules that do not take part.
    fallback_used : bool
        Whether the run's own solver left the answer unproved, so that the exact solver gave this one.
    commanded : (m,) array
        Set-points in N, after the limit on their change; NaN where none was sent.
    sequences : (m,) array of int
        Their sequence numbers; -1 where none was sent.
    start_delay : float
        How long after its deadline the cycle began, in s.
    compute_time : float
        What the host needed for it, in s.
    """

    state: RigState
    demand: Demand
    solver_wrench: Floats
    allocation: Allocation
    fallback_used: bool
    commanded: Floats
    sequences: Integers
    start_delay: float
    compute_time: float


KEPT = 100_000
"""Cycles whose times are kept for percentiles."""
DURATION_REACHED = "duration reached"
DEMAND_STOPPED = "stopped by the demand"
"""What ends a run in good order; other ends are signals, an emergency stop and errors."""
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
    fallback_used : int
        Cycles in which the exact solver gave the answer.
    slew_limited : int
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
    start_delays, compute_times : deque of float
        Time from deadline to begin of the latest cycles, and what the host needed for each, in s.
    """

    cycles: int = 0
    missed: int = 0
    fallback_used: int = 0
    slew_limited: int = 0
    statuses: Counter[Status] = field(default_factory=Counter)
    late_telemetry: Counter[str] = field(default_factory=Counter)
    derated: dict[str, float] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)
    ended: str = ""
    emergency: bool = False
    unconfirmed: dict[str, str] = field(default_factory=dict)
    start_delays: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    compute_times: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))

    def take(self, cycle: Cycle, *, slew_limited: bool) -> None:
        """Count a cycle."""
        self.cycles += 1
        self.fallback_used += cycle.fallback_used
        self.slew_limited += slew_limited
        self.statuses[STATUSES[int(cycle.allocation.status)]] += 1
        self.start_delays.append(cycle.start_delay)
        self.compute_times.append(cycle.compute_time)

    def percentiles(self) -> dict[str, tuple[float, ...]]:
        """Median, 99th percentile and largest delay and compute time, in s; zeros before the first cycle."""
        return {
            name: tuple(float(value) for value in np.percentile(list(times) or [0.0], PERCENTILES))
            for name, times in (("start_delay", self.start_delays), ("compute_time", self.compute_times))
        }

    def summary(self) -> dict[str, Any]:
        """The same as plain numbers and texts; times in s."""
        named = ("median", "p99", "max")
        times = {f"{name}_s": dict(zip(named, values, strict=True)) for name, values in self.percentiles().items()}
        return {
            "ended": self.ended,
            "emergency": self.emergency,
            "cycles": self.cycles,
            "missed": self.missed,
            "fallback_used": self.fallback_used,
            "slew_limited": self.slew_limited,
            "statuses": {status.name: self.statuses[status] for status in Status},
            "late_telemetry": dict(self.late_telemetry),
            "derated": self.derated,
            "lost": self.lost,
            "unconfirmed": self.unconfirmed,
            **times,
        }
