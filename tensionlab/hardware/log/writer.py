"""Log of a run, written while it runs: every cycle, every event between, and a scene for viewers of robots.

The columns of a cycle are those of ``hardware/runner/cycle_table.py``.
"""

from __future__ import annotations

import json
import math
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from tensionlab.allocation import Policy, Solver, resolve_solver
from tensionlab.errors import LogError, WriteError
from tensionlab.hardware.log import scene
from tensionlab.hardware.log.mcap_file import McapWriter
from tensionlab.hardware.protocol.messages import Info
from tensionlab.hardware.runner import cycle_table
from tensionlab.hardware.runner.records import Cycle, RunEvent, Statistics
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import MAX_MAGNITUDE
from tensionlab.support.files.reading import as_path

FLUSH_S = 0.2  # records are flushed after this time, and then outlive the process
MAX_BACKLOG = 20_000  # number of cycles and events that may wait for a slow disk; at 1 kHz, 20 s
# Pause of the writer in favour of the control loop: after each cycle while more wait, and after each picture; none
# while more than `MAX_YIELDING` wait, as a loop that never sleeps would leave it too little time.
YIELD_S = 50e-6
MAX_YIELDING = 200
CLOSE_TIMEOUT_S = 10.0  # longest time to write pending records when the run ends

EVENT_SCHEMA = {**TypeAdapter(RunEvent).json_schema(), "title": "tensionlab.Event"}


@dataclass(frozen=True)
class RunSetup:
    """Setup of a run; rate, ttl and on_loss are as in `RunSettings`."""

    solver: str  # its name in `tensionlab.SOLVERS`; for an instance, the name of its class
    parameters: Mapping[str, Any]  # hyper-parameters of the solver
    policy: Policy | None  # its policy for infeasible wrenches
    rate: Annotated[float, Field(gt=0.0, lt=MAX_MAGNITUDE)]
    ttl: float
    on_loss: str
    lower: tuple[float, ...]  # tension limits of the solver, in N
    upper: tuple[float, ...]
    links: Mapping[str, str]  # link to each module, by its name
    scenery: Mapping[str, Any] = field(default_factory=dict)  # what pages draw around the rig


class RunLog:
    """Log of a run, written by a thread, so that no cycle waits for a disk.

    Every cycle is in the file within `FLUSH_S` seconds, even if the process is killed then. Closing the log writes
    its index and marks it complete. LogError if the file is not empty, or cannot be written.

    Parameters
    ----------
    path : path
        An MCAP file (``.mcap``): new, or empty.
    rig : Rig
    manifest : mapping
        Origin of the run: `tensionlab.support.provenance.manifest`.
    solver, settings : str or Solver, RunSettings
        As those of the `Runner`.
    links : mapping of str to str
        Link to each module, by its name.
    scenery : mapping, optional
        What pages draw around the rig, as plain values (`tensionlab.scenarios.scenery`).
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        rig: Rig,
        manifest: Mapping[str, Any],
        solver: str | Solver,
        settings: RunSettings,
        links: Mapping[str, str],
        scenery: Mapping[str, Any] | None = None,
    ) -> None:
        made, policy = resolve_solver(solver, settings.policy)
        name = solver if isinstance(solver, str) else type(solver).__name__
        lower, upper = (tuple(limit.tolist()) for limit in (rig.limits.lower, rig.limits.upper))
        timing = (settings.rate, settings.ttl, settings.on_loss)
        setup = RunSetup(name, vars(made), policy, *timing, lower, upper, links, scenery or {})
        self.path = as_path(path)
        self._rig = rig
        self._queue: SimpleQueue[tuple[str, int, int, Any] | None] = SimpleQueue()
        self._error: LogError | None = None
        self._summary: Mapping[str, Any] = {}
        self._begin_ns: int | None = None
        self._time = 0.0
        self._scene = scene.SceneEncoder(rig)
        self._file = self._open(manifest, setup)
        self._thread = threading.Thread(target=self._run, name=f"log {self.path.name}", daemon=True)
        self._thread.start()

    def _open(self, manifest: Mapping[str, Any], setup: RunSetup) -> McapWriter:
        """Begin the file with what is known before the run; leave none behind where that fails."""
        schemas = {
            "cycle": cycle_table.schema(),
            "effects": cycle_table.EFFECTS_SCHEMA,
            "event": EVENT_SCHEMA,
            scene.TOPIC: scene.SCHEMA,
        }
        try:
            file = McapWriter(self.path, schemas)
            try:
                file.attachment("rig.toml", "application/toml", rig_to_toml(self._rig).encode())
                file.metadata("manifest", manifest)
                file.metadata("setup", asdict(setup))
                file.flush()
            except BaseException:
                file.abandon()
                self.path.unlink(missing_ok=True)
                raise
        except WriteError as error:
            raise LogError(str(error)) from None
        except OSError as error:
            raise _unwritable(self.path, error) from None
        return file

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Write the description of each module, by its name.

        A `LogError`, here and in `write` and `note`, if something before could not be written: the disk is full,
        or does not keep up.
        """
        self._put("modules", {name: asdict(info) for name, info in infos.items()})

    def write(self, cycle: Cycle) -> None:
        """Write a cycle, whose arrays must not change any more."""
        if self._begin_ns is None:
            self._begin_ns = time.time_ns() - int(1e9 * cycle.state.time)
        self._time = cycle.state.time
        self._put("cycle", cycle)

    def note(self, event: RunEvent) -> None:
        """Write an event, such as the loss of a module; from any thread."""
        self._put("event", asdict(event))

    def close(self, statistics: Statistics | None = None) -> None:
        """Write what is queued, the summary, and the index; a `LogError` if not all of it could be written."""
        if self._thread.is_alive():
            self._summary = {} if statistics is None else statistics.summary()
            self._queue.put(None)
            self._thread.join(CLOSE_TIMEOUT_S)
            if self._thread.is_alive():
                slow = f"the disk did not take the last cycles within {CLOSE_TIMEOUT_S:g} s"
                self._error = LogError(f"{self.path}: {slow}")
        if self._error is not None:
            raise self._error

    def _put(self, topic: str, what: Any) -> None:
        if self._error is None and self._queue.qsize() >= MAX_BACKLOG:
            slow = f"the disk does not keep up; {MAX_BACKLOG} cycles wait to be written"
            self._error = LogError(f"{self.path}: {slow}")
        if not self._thread.is_alive() and self._error is None:  # in this order: an error ends the thread
            self._error = LogError(f"{self.path}: the log is closed; nothing can be added to it")
        if self._error is not None:
            raise self._error
        now = time.time_ns()
        when = now if self._begin_ns is None else self._begin_ns + int(1e9 * self._time)
        self._queue.put((topic, when, now, what))

    def _run(self) -> None:
        try:
            self._write_all()
            if self._summary:
                self._file.metadata("summary", self._summary)
            self._file.finish()
        except OSError as error:
            self._error = _unwritable(self.path, error)
        except Exception as error:  # a thread's exception would be lost
            self._error = LogError(f"{self.path}: a cycle could not be written ({error!r})")
        finally:
            self._file.abandon()

    def _write_all(self) -> None:
        due = math.inf  # when what was written must be flushed
        while True:
            try:
                item = self._queue.get(timeout=None if due == math.inf else max(due - time.perf_counter(), 0.0))
            except Empty:
                due = -math.inf
            else:
                if item is None:
                    return
                self._write_one(*item)
                due = min(due, time.perf_counter() + FLUSH_S)
            if time.perf_counter() >= due:
                self._file.flush()
                due = math.inf
            if self._queue.qsize() > 0:
                self._yield()

    def _yield(self) -> None:
        """Leave the interpreter to the control loop for a moment, unless too much waits."""
        if self._queue.qsize() < MAX_YIELDING:
            time.sleep(YIELD_S)

    def _write_one(self, topic: str, when: int, now: int, what: Any) -> None:
        if topic == "modules":
            self._file.metadata(topic, what)
        elif topic == "event":
            self._file.message(topic, when, now, json.dumps(what).encode())
        else:
            self._file.message(topic, when, now, cycle_table.encode(what, self._rig))
            if what.demand.effects:
                self._file.message("effects", when, now, cycle_table.encode_effects(what))
            if (picture := self._scene.encode(what, when)) is not None:
                self._yield()
                self._file.message(scene.TOPIC, when, now, picture)


def _unwritable(path: Path, error: OSError) -> LogError:
    return LogError(
        f"{path}: the log cannot be written ({error.strerror or error}); free the disk or name another file"
    )
