"""The run of this process, published for other processes on this computer, and its watchers there.

The publisher (`tensionlab.hardware.client.shared_telemetry`) packs the state of the run in its own thread, and
only on request: a cycle does nothing for it.
"""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from itertools import count, islice
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Solver
from tensionlab.errors import TensionlabError
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.locks import holders, program
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.shared_telemetry import Watcher
from tensionlab.hardware.protocol.messages import Decoder, Info, Telemetry
from tensionlab.hardware.runner.cycle_table import decode, encode
from tensionlab.hardware.runner.records import Cycle, RunEvent, Statistics
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.model.files import rig_from_toml, rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers

RUN, SETUP = "run", "setup"  # topics of the publisher: the state of a run, and its constant part
MAX_EVENTS = 30  # latest events that are kept for other processes
MAX_TIMES = 100  # latest cycles whose times are in an answer: all since the last one, at 1 kHz
# Between polls of a watcher; answers come no faster than every `shared_telemetry.MIN_PERIOD_S`.
POLL_S = 1.0 / 30.0
ASK_AGAIN_S = 0.25  # a request without an answer after this time was lost
MIN_STALE_S, STALE_PERIODS = 0.5, 5.0  # least time, and number of periods, after which a run is stale
FIND_TIMEOUT_S = 2.0  # longest wait for processes to describe their run
SHARED_STATISTICS = (
    "cycles", "missed", "fallback_used", "answers", "lost", "unconfirmed", "ended", "emergency",
)  # fmt: skip
Condition = Literal["waiting", "arming", "live", "stale", "ended", "gone"]
_numbers = count()


@dataclass(frozen=True)
class RunInfo:
    """Constant part of a run: solver, rate and time to live as in `RunSettings`, and the URL of each module."""

    number: int  # of the run in its process
    pid: int
    program: str  # command line of the process
    rig: Rig
    solver: str  # its name, or that of its class
    rate: float
    ttl: float
    links: Mapping[str, str]
    scenery: Mapping[str, Any] = field(default_factory=dict)  # what pages draw around the rig


class SharedRun:
    """Sink of a run that publishes it, until another run begins; without a publisher it does nothing.

    Rig, solver and settings are those of the `Runner`, the scenery as in `RunInfo`.
    """

    def __init__(
        self,
        rig: Rig,
        solver: str | Solver,
        settings: RunSettings,
        clients: Sequence[ModuleClient],
        scenery: Mapping[str, Any] | None = None,
    ) -> None:
        self._rig, self._clients, self._published = rig, clients, shared_telemetry.started()
        self._number = next(_numbers)
        self._latest: Cycle | None = None
        self._statistics = Statistics()
        self._events: deque[RunEvent] = deque(maxlen=MAX_EVENTS)
        name = solver if isinstance(solver, str) else type(solver).__name__
        links = {client.name: client.link.url for client in clients}
        info = RunInfo(
            self._number, os.getpid(), program(), rig, name, settings.rate, settings.ttl, links, scenery or {}
        )
        if self._published is not None:
            setup = json.dumps(vars(info) | {"rig": rig_to_toml(rig)}).encode()
            self._published.topics |= {SETUP: lambda: setup, RUN: self.pack}

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Publish these statistics from now on."""
        self._statistics = statistics

    def write(self, cycle: Cycle) -> None:
        """Publish the latest cycle."""
        self._latest = cycle

    def note(self, event: RunEvent) -> None:
        """Publish an event."""
        self._events.append(event)

    def close(self, statistics: Statistics) -> None:
        """Publish how the run has ended, and tell watchers."""
        self._statistics = statistics
        last = self.pack(over=True)
        if self._published is not None:
            self._published.topics[RUN] = lambda: last
            self._published.announce(RUN)

    def pack(self, *, over: bool = False) -> bytes:
        """Return the run as it is now; ``over`` when its modules have been commanded to stop."""
        cycle, statistics = self._latest, self._statistics
        known = np.ones(len(self._clients)) if cycle is None else np.isfinite(cycle.state.tensions)
        telemetry = [
            client.telemetry if is_known else None for client, is_known in zip(self._clients, known, strict=True)
        ]
        row: dict[str, Any] = {name: getattr(statistics, name) for name in SHARED_STATISTICS} | {
            "number": self._number,
            "over": over,
            "bad_frames": [client.bad_frames for client in self._clients],
            "telemetry": ["" if latest is None else latest.message.frame(0).pack().hex() for latest in telemetry],
            **{
                name: list(islice(reversed(getattr(statistics, name)), MAX_TIMES))[::-1]
                for name in ("start_delays", "compute_times")
            },
            "events": [asdict(event) for event in list(self._events)],
        }
        newest = b"null" if cycle is None else encode(cycle, self._rig)
        return b'{"cycle":' + newest + b"," + json.dumps(row).encode()[1:]


@dataclass(frozen=True, eq=False)
class RunSnapshot:
    """State of a run, as its process published it; the counts, and how it ended, are as in `Statistics`."""

    number: int  # of the run in its process
    over: bool  # whether its modules have been commanded to stop; `ended` says why
    cycle: Mapping[str, NDArray[Any]] | None  # the latest, by the names of `CycleTable`; None before the first
    bad_frames: Integers  # (m,) damaged frames of the modules
    telemetry: tuple[Telemetry | None, ...]  # latest of each module; None before the first, and of an old one
    start_delays: Floats  # (k,) of the latest cycles, in s, the latest last
    compute_times: Floats  # (k,)
    cycles: int
    missed: int
    fallback_used: int
    answers: str
    lost: Mapping[str, str]
    unconfirmed: Mapping[str, str]
    ended: str
    emergency: bool
    events: tuple[RunEvent, ...]  # the latest

    @classmethod
    def unpack(cls, row: dict[str, Any], rig: Rig) -> RunSnapshot:
        """Read an answer about a run of this rig; KeyError, TypeError or ValueError if it is none."""
        values = dict(row)
        if values["cycle"] is not None:
            columns = decode([json.dumps(values["cycle"]).encode()], rig)
            values["cycle"] = {name: column[0] for name, column in columns.items()}
        for name in ("start_delays", "compute_times"):
            values[name] = np.array(values[name], np.float64)
        values["bad_frames"] = np.array(values["bad_frames"], np.int64)
        frames = [Decoder().feed(bytes.fromhex(text)) for text in values["telemetry"]]
        values["telemetry"] = tuple(Telemetry.unpack(parsed[0].payload) if parsed else None for parsed in frames)
        values["events"] = tuple(RunEvent(**event) for event in values["events"])
        return cls(**values)


class RunWatcher:
    """Watcher of the run of another process; `poll` it some twenty times a second.

    `info` and `report` are the latest, None before the first; a new run replaces one that has ended.
    """

    def __init__(self, port: int, token: str) -> None:
        self.info: RunInfo | None = None
        self.report: RunSnapshot | None = None
        self._watcher = Watcher(port, token)
        self._asked = -ASK_AGAIN_S
        self._came = self._newer = time.perf_counter()
        self._advances = False
        self.close = self._watcher.close

    def poll(self) -> None:
        """Read the answers, and ask again."""
        now = time.perf_counter()
        answered = False
        for content in self._watcher.answers():
            with suppress(ValueError, ArithmeticError, LookupError, TypeError, TensionlabError):
                self._store(json.loads(content), now)
                answered = True
        if not self._watcher.refused and (answered or now > self._asked + ASK_AGAIN_S):
            self._asked = now
            self._watcher.ask(SETUP if self.info is None else RUN)

    def _store(self, row: dict[str, Any], now: float) -> None:
        if "rig" in row:
            self.info = RunInfo(**row | {"rig": rig_from_toml(str(row["rig"]), "the rig of the run")})
            self.report, self._advances, self._newer = None, False, now
        elif self.info is not None and row["number"] != self.info.number:
            self.info = self.report = None  # another run has begun
        elif self.info is not None:
            previous_report, self.report = self.report, RunSnapshot.unpack(row, self.info.rig)
            if previous_report is None or previous_report.cycles != self.report.cycles:
                self._advances, self._newer = previous_report is not None, now
        self._came = now

    @property
    def age(self) -> float:
        """Time since the latest cycle came, in s; before the first one, since the latest answer."""
        begun = self.report is not None and self.report.cycle is not None
        return time.perf_counter() - (self._newer if begun else self._came)

    @property
    def condition(self) -> Condition:
        """Condition of the run.

        "waiting" for an answer, "arming" before the first cycle, "live", "stale" without newer cycles, "ended", or
        "gone": its process ended unexpectedly.
        """
        if self.report is not None and self.report.over:
            return "ended"
        if self._watcher.refused:
            return "gone"
        if self.report is None or self.info is None:
            return "waiting"
        if self.age > max(MIN_STALE_S, STALE_PERIODS / self.info.rate):
            return "stale"
        if self.report.cycle is None:
            return "arming"
        return "live" if self._advances else "waiting"


def find_runs() -> list[RunWatcher]:
    """Return a watcher of each run whose process has or simulates modules of this user."""
    ports = {(owner.port, owner.token) for owner in holders().values() if owner.port is not None}
    watchers = [RunWatcher(port, token) for port, token in ports]
    end = time.perf_counter() + FIND_TIMEOUT_S
    while any(watcher.info is None for watcher in watchers) and time.perf_counter() < end:
        for watcher in watchers:
            watcher.poll()
        time.sleep(POLL_S)
    for watcher in watchers:
        if watcher.info is None:
            watcher.close()
    return [watcher for watcher in watchers if watcher.info is not None]
