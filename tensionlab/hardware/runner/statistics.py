"""Counts and times over the cycles of a run: kept up while it runs, or recounted from its log."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tensionlab.allocation import Status
from tensionlab.support.formatting import format_count, format_duration
from tensionlab.support.table import STATUS_MARKS, Mark, Table

MAX_TIMES = 100_000  # cycles whose times are kept for percentiles while a run lasts
DURATION_REACHED = "duration reached"
DEMAND_STOPPED = "stopped by the demand"
# Signals that end a run in good order; other ends are other signals, an emergency stop and errors.
CTRL_C = "signal SIGINT"
# `tensionlab estop`, or another sender of `ESTOP_SIGNAL`, ended it.
EMERGENCY_STOP = "emergency stop (from another terminal)"
STATUSES = tuple(sorted(Status))
PERCENTILES = {"median": 50.0, "p99": 99.0, "max": 100.0}


@dataclass
class Statistics:
    """Counts and times of a run."""

    cycles: int = 0
    missed: int = 0  # deadlines that no cycle began at, because one before them was still going on
    fallback_used: int = 0  # cycles in which the exact solver gave the answer
    slew_limited: int = 0  # cycles whose set-points went only a part of the way, by the limit on their change
    statuses: Counter[Status] = field(default_factory=Counter)  # of the allocations sent
    # Cycles in which a module's latest telemetry was more than two of its periods old, by module.
    late_telemetry: Counter[str] = field(default_factory=Counter)
    # Modules whose upper tension limit was lowered because their winding got warm, and the lowest, in N.
    derated: dict[str, float] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)  # modules, and why
    ended: str = ""  # by what
    emergency: bool = False  # whether that was an emergency stop from elsewhere
    unconfirmed: dict[str, str] = field(default_factory=dict)  # modules that did not confirm the stop, and why
    start_delays: deque[float] = field(
        default_factory=lambda: deque(maxlen=MAX_TIMES)
    )  # of the latest cycles, in s
    compute_times: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_TIMES))

    def __repr__(self) -> str:
        return f"<Statistics of {self.title}: {self.answers}, {self.missed} missed>"

    def _repr_html_(self) -> str:
        return self.table(self.title)._repr_html_()

    def table(self, title: str) -> Table:
        """Return counts and times, with a row for each status."""
        answers: list[tuple[Mark | str, str]] = [
            (STATUS_MARKS[status], format_count(self.statuses[status], "cycle"))
            for status in STATUSES
            if self.statuses[status]
        ]
        if self.fallback_used:
            answers.append(("by newton, as fallback of the solver", format_count(self.fallback_used, "cycle")))
        return Table(["", ""], [*answers, *self.rows()[1:]], title)

    @property
    def title(self) -> str:
        """Number of cycles, and what ended them."""
        return f"{self.cycles} cycles" + (f", finished: {self.ended}" if self.ended else "")

    @property
    def answers(self) -> str:
        """How many answers have which status, and how many are the fallback's."""
        counts = [f"{self.statuses[status]} {status.name}" for status in Status if self.statuses[status]]
        if self.fallback_used:
            counts.append(f"{self.fallback_used} by newton, as fallback of the solver")
        return ", ".join(counts) or "none"

    @property
    def explained(self) -> str:
        """The answers, and what to know of those that are infeasible."""
        why = "; NEAREST: what is desired is infeasible, and the nearest to it is rendered"
        return self.answers + why * bool(self.statuses[Status.NEAREST])

    def rows(self) -> list[tuple[str, str]]:
        """Return what to know of a run as lines of two texts."""
        words = "{} median, {} p99, {} max"
        times = [words.format(*map(format_duration, each)) for each in self.percentiles().values()]
        rows = [
            ("answers", self.explained),
            ("start jitter", times[0]),
            ("compute time of a cycle", times[1]),
            ("deadlines missed", str(self.missed)),
        ]
        if self.slew_limited:
            rows.append(("cycles that were slew-rate limited", str(self.slew_limited)))
        for name, count in self.late_telemetry.items():
            rows.append((f"cycles with late telemetry of {name}", str(count)))
        for name, upper in self.derated.items():
            rows.append((f"derated: {name}", f"down to {upper:.2f} N, so that it did not get too hot"))
        return rows + [(f"lost: {name}", why) for name, why in self.lost.items()]

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

    def percentiles(self) -> dict[str, tuple[float, ...]]:
        """Return median, 99th percentile and largest delay and compute time, in s."""
        return {"start_delay": percentiles(self.start_delays), "compute_time": percentiles(self.compute_times)}

    def counts(self) -> dict[str, Any]:
        """Return what can be recounted from a log, as plain numbers; times are zero before the first cycle."""
        return {
            "cycles": self.cycles,
            "missed": self.missed,
            "fallback_used": self.fallback_used,
            "slew_limited": self.slew_limited,
            "statuses": {status.name: self.statuses[status] for status in Status},
            **{
                f"{name}_s": dict(zip(PERCENTILES, np.nan_to_num(values).tolist(), strict=True))
                for name, values in self.percentiles().items()
            },
        }

    def summary(self) -> dict[str, Any]:
        """Return all of it as plain numbers and texts."""
        return {
            "ended": self.ended,
            "emergency": self.emergency,
            **self.counts(),
            "late_telemetry": dict(self.late_telemetry),
            "derated": self.derated,
            "lost": self.lost,
            "unconfirmed": self.unconfirmed,
        }


def percentiles(values: Iterable[float]) -> tuple[float, ...]:
    """Return median, 99th percentile and largest of the values that are numbers; NaN where there is none."""
    numbers = np.fromiter(values, dtype=np.float64)
    numbers = numbers[np.isfinite(numbers)]
    if not numbers.size:
        return (np.nan,) * len(PERCENTILES)
    return tuple(np.percentile(numbers, list(PERCENTILES.values())).tolist())
