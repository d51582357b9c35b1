"""Records that a run hands to its sinks: cycles, events, and the statistics of the whole."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from tensionlab.allocation import Allocation, Status
from tensionlab.demand import Demand, RigState
from tensionlab.hardware.protocol.messages import Info
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.formatting import format_duration
from tensionlab.support.table import Table


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a run.

    Attributes
    ----------
    state, demand : RigState, Demand
        At its begin; the wrench of the demand with what the rig requires.
    solver_wrench : (n,) array
        Demanded wrench minus what impedances and lost modules pull.
    allocation : Allocation
        What the solver chose, verified; with tension 0 in modules that do not take part.
    fallback_used : bool
        Whether the exact solver answered because the run's own left its answer unproven.
    commanded, sequences : (m,) array, (m,) array of int
        Set-points in N, after the limit on their change and with the friction that they compensate, and their
        sequence numbers; NaN and -1 where none was sent.
    start_delay, compute_time : float
        Begin of the cycle after its deadline, and time that the host needed for it, in s.
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


@dataclass(frozen=True)
class RunEvent:
    """Event in a run."""

    cycle: int  # number of the latest cycle; -1 before the first
    time: float  # begin of that cycle, in s since the run began
    kind: str  # in one word
    text: str  # in one sentence
    module: str = ""  # name of the module; empty for none or all


class RunSink(Protocol):
    """Sink for all that happens in a run, such as `RunLog`. A `HardwareError` of it ends the run."""

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Take the description of each module, by its name, and the statistics, which grow during the run."""

    def write(self, cycle: Cycle) -> None:
        """Take a cycle. Its arrays do not change any more."""

    def note(self, event: RunEvent) -> None:
        """Take an event; from any thread."""

    def close(self, statistics: Statistics) -> None:
        """Take the final statistics; nothing comes after that."""


ROUNDING_S = 1e-9
MAX_TIMES = 100_000  # number of latest cycles whose times are kept for percentiles
DURATION_REACHED = "duration reached"
DEMAND_STOPPED = "stopped by the demand"
CTRL_C = "signal SIGINT"
EMERGENCY_STOP = "emergency stop (from another terminal)"  # by `tensionlab estop`, or another ESTOP_SIGNAL
STATUSES = tuple(sorted(Status))
PERCENTILES = {"median": 50.0, "p99": 99.0, "max": 100.0}


@dataclass
class Statistics:
    """Counts and times over the cycles of a run: updated while it runs, or recounted from its log."""

    cycles: int = 0
    missed: int = 0  # deadlines at which an earlier cycle was still in progress
    fallback_used: int = 0  # cycles in which the exact solver gave the answer
    slew_limited: int = 0  # cycles in which the limit on the change of set-points held
    statuses: Counter[Status] = field(default_factory=Counter)  # of the allocations sent
    # Cycles in which a module's latest telemetry was more than two of its periods old, by module.
    late_telemetry: Counter[str] = field(default_factory=Counter)
    # Lowest upper tension limit of each module whose limit was lowered because its winding got warm, in N.
    derated: dict[str, float] = field(default_factory=dict)
    near: dict[str, str] = field(default_factory=dict)  # modules whose cables neared bodies, and how close
    lost: dict[str, str] = field(default_factory=dict)  # modules, and why
    ended: str = ""  # by what
    emergency: bool = False  # whether that was an emergency stop from elsewhere
    unconfirmed: dict[str, str] = field(default_factory=dict)  # modules that did not confirm the stop, and why
    start_delays: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_TIMES))  # in s
    compute_times: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_TIMES))

    def add(
        self, status: int, start_delay: float, compute_time: float, *, fallback_used: bool, slew_limited: bool
    ) -> None:
        """Count a cycle; times in s."""
        self.cycles += 1
        self.fallback_used += fallback_used
        self.slew_limited += slew_limited
        self.statuses[STATUSES[status]] += 1
        self.start_delays.append(start_delay)
        self.compute_times.append(compute_time)

    @property
    def title(self) -> str:
        """Number of cycles, and what ended them."""
        return f"{self.cycles} cycles" + (f", finished: {self.ended}" if self.ended else "")

    @property
    def answers(self) -> str:
        """Number of answers of each status, and of those by the fallback."""
        counts = [f"{self.statuses[status]} {status.name}" for status in Status if self.statuses[status]]
        if self.fallback_used:
            counts.append(f"{self.fallback_used} by newton, as fallback of the solver")
        return ", ".join(counts) or "none"

    @property
    def explained(self) -> str:
        """The answers, with a remark on infeasible ones."""
        why = "; NEAREST: what is desired is infeasible, and the nearest to it is rendered"
        return self.answers + why * bool(self.statuses[Status.NEAREST])

    def __repr__(self) -> str:
        return f"<Statistics of {self.title}: {self.answers}, {self.missed} missed>"

    def _repr_html_(self) -> str:
        return Table(["", ""], self.rows(), self.title)._repr_html_()

    def rows(self) -> list[tuple[str, str]]:
        """Return counts and times as pairs of a name and a text."""
        words = "{} median, {} p99, {} max"
        jitter, compute = (words.format(*map(format_duration, values)) for values in self.percentiles().values())
        starts = [("start jitter", jitter), ("deadlines missed", str(self.missed))] * self.in_real_time
        slewed = [("cycles that were slew-rate limited", str(self.slew_limited))] * bool(self.slew_limited)
        by_module: dict[str, Mapping[str, Any]] = {
            "cycles with late telemetry of {}": self.late_telemetry,
            "derated: {}": {name: f"down to {upper:.2f} N, so that it did not get too hot"
                            for name, upper in self.derated.items()},
            "near a body: {}": self.near,
            "lost: {}": self.lost,
        }  # fmt: skip
        modules = [
            (title.format(name), str(text)) for title, texts in by_module.items() for name, text in texts.items()
        ]
        return [("answers", self.explained), ("compute time of a cycle", compute), *starts, *slewed, *modules]

    @property
    def in_real_time(self) -> bool:
        """Whether any of the latest cycles began later than it was due; in simulated time none does."""
        return max(self.start_delays, default=0.0) > ROUNDING_S

    def percentiles(self) -> dict[str, tuple[float, ...]]:
        """Return median, 99th percentile and largest delay and compute time, in s."""
        return {"start_delay": percentiles(self.start_delays), "compute_time": percentiles(self.compute_times)}

    def counts(self) -> dict[str, Any]:
        """Return what can be recounted from a log, as plain numbers; times are zero before the first cycle."""
        times = {
            f"{name}_s": dict(zip(PERCENTILES, np.nan_to_num(values).tolist(), strict=True))
            for name, values in self.percentiles().items()
        }
        counts = {name: getattr(self, name) for name in ("cycles", "missed", "fallback_used", "slew_limited")}
        return {**counts, "statuses": {status.name: self.statuses[status] for status in Status}, **times}

    def summary(self) -> dict[str, Any]:
        """Return all of it as plain numbers and texts."""
        by_name = ("late_telemetry", "derated", "near", "lost", "unconfirmed")
        by_module = {name: dict(getattr(self, name)) for name in by_name}
        return {"ended": self.ended, "emergency": self.emergency, **self.counts(), **by_module}


def percentiles(values: Iterable[float]) -> tuple[float, ...]:
    """Return median, 99th percentile and largest of the finite values; NaN where there is none."""
    numbers = np.fromiter(values, dtype=np.float64)
    numbers = numbers[np.isfinite(numbers)]
    if not numbers.size:
        return (np.nan,) * len(PERCENTILES)
    return tuple(np.percentile(numbers, list(PERCENTILES.values())).tolist())
