"""Simulated modules, served byte for byte in real time to whoever connects to them."""

from __future__ import annotations

import math
import random
import re
import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tensionlab.errors import HardwareError
from tensionlab.files import writing
from tensionlab.hardware.simulation.channel import Channel, Conditions
from tensionlab.hardware.simulation.ports import Port
from tensionlab.hardware.simulation.simulated_module import PARTS, STEP_S, SimulatedModule

TICK, IDLE_TICK = 1e-3, 20e-3
"""How often time passes in a module that has a client, and in one that has none, in s."""
LATE = 20e-3
"""What the server is late beyond this, in s, is time that does not pass in its modules: a busy machine must not
make them time out."""
PIECE = 64
"""Bytes that a module takes at a time, as on the ESP32: the answers to more may not find room."""
FAULT = re.compile(r"(?P<part>[a-z]+)@(?P<when>\d+(\.\d+)?)(?P<unit>ms|s)?")


@dataclass(frozen=True)
class PlannedFault:
    """What breaks, and how many s after the start."""

    part: str
    seconds: float


def parse_fault(text: str) -> PlannedFault:
    """Which fault does ``encoder@2s`` plan? Times are in s, or ms if that is said.

    Raises
    ------
    HardwareError
        For a part that a module does not have, or a time that is none.
    """
    found = FAULT.fullmatch(text)
    if found is None or found["part"] not in PARTS:
        raise HardwareError(f"no fault {text!r}; write one of {', '.join(PARTS)} and a time, such as encoder@2s")
    return PlannedFault(found["part"], float(found["when"]) * (1e-3 if found["unit"] == "ms" else 1.0))


class ServedModule:
    """A simulated module at a port, behind a link of given conditions.

    Parameters
    ----------
    module : SimulatedModule
        Its settings are those of the file already, if there is one.
    port : Port
        Where it is reached. A client that goes away is a link that closed.
    conditions : Conditions
        Of the link.
    seed : int
        Of the link's accidents.
    faults : sequence of PlannedFault
        What breaks, and when.
    settings_file : Path, optional
        Written when the module saves.
    far_end : callable, optional
        How long the cable is in m, asked at each step; as at the start if left out.
    """

    def __init__(
        self,
        module: SimulatedModule,
        port: Port,
        *,
        conditions: Conditions | None = None,
        seed: int = 0,
        faults: Sequence[PlannedFault] = (),
        settings_file: Path | None = None,
        far_end: Callable[[], float] | None = None,
    ) -> None:
        self.module, self.port, self._far_end = module, port, far_end
        conditions = Conditions() if conditions is None else conditions
        self._inbound = Channel(conditions, random.Random(f"in {seed}"))
        self._outbound = Channel(conditions, random.Random(f"out {seed}"))
        self._faults = sorted(faults, key=lambda fault: fault.seconds, reverse=True)
        self._settings_file, self._settings = settings_file, module.settings
        self._steps = 0

    def serve(self, now: float) -> None:
        """Do what is to be done by a time, in s since the start."""
        came = self.port.receive()
        if came is None:
            self._outbound.clear()
        if came != b"":
            self._inbound.put(came, now)
        self._advance(now)
        self._listen(now)  # what the module said as time passed
        for arrived in self._inbound.take(now):
            if arrived is None:
                self.module.close_link()
                continue
            for begin in range(0, len(arrived), PIECE):
                self.module.receive(arrived[begin : begin + PIECE])
                self._listen(now)
        for arrived in self._outbound.take(now):
            if arrived:
                self.port.send(arrived)

    def due(self, now: float) -> float:
        """When it is to be served again at the latest, in s since the start."""
        tick = TICK if self.port.connected() else IDLE_TICK
        return min((int(now / tick + 1e-6) + 1) * tick, self._inbound.due, self._outbound.due)

    def _listen(self, now: float) -> None:
        said = self.module.transmit()
        if said:
            self._outbound.put(said, now)

    def _advance(self, now: float) -> None:
        while self._faults and self._faults[-1].seconds <= now:
            self.module.damage(self._faults.pop().part)
        steps = int(now / STEP_S) - self._steps
        self._steps += steps
        self.module.advance(steps * STEP_S, None if self._far_end is None else self._far_end())
        if self._settings_file is not None and self.module.settings != self._settings:
            self._settings = self.module.settings
            writing.write_bytes(self._settings_file, self._settings)


def serve(
    modules: Sequence[ServedModule],
    speed: float,
    stopped: Callable[[], bool],
    watchers: Sequence[Callable[[Sequence[SimulatedModule]], None]] = (),
    longest: float = math.inf,
) -> None:
    """Let time pass in all modules, `speed` times as fast as here, until it is to stop.

    After each step, ``watchers`` see the modules. One thread for all: a module needs some 3 % of a processor, and
    they can't keep each other from running. Deadlines are absolute, so that no delay adds to another. No step is
    longer than ``longest`` s, for watchers that the modules pull. Ports are closed at the end.
    """
    start, now = time.monotonic(), 0.0
    try:
        while not stopped():
            due = min(served.due(now) for served in modules)
            files = [file for served in modules for file in served.port.files()]
            wait = max(start + due / speed - time.monotonic(), 0.0)
            select.select(files, [], [], min(wait, IDLE_TICK))
            then, now = now, (time.monotonic() - start) * speed
            late = now - due - LATE
            if late > 0.0:
                start += late / speed
                now -= late
            pieces = max(math.ceil((now - then) / longest), 1)
            for piece in range(1, pieces + 1):
                for served in modules:
                    served.serve(then + (now - then) * piece / pieces)
                for watch in watchers:
                    watch([served.module for served in modules])
    finally:
        for served in modules:
            served.port.close()


def read_settings(path: Path) -> bytes | None:
    """What did an earlier module store in the file? None if there is no such file.

    Raises
    ------
    HardwareError
        If it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise HardwareError(f"{path}: cannot be read ({error.strerror}); name a file for settings") from None
