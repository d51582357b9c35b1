"""Simulated modules served in real time at TCP ports."""

from __future__ import annotations

import random
import re
import select
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from typing import NamedTuple, Protocol

from tensionlab.errors import InputError, cannot_listen
from tensionlab.hardware.simulation.links import Channel, Conditions
from tensionlab.hardware.simulation.simulated_module import PARTS, STEP_S, SimulatedModule

READ_BYTES = 65536


class TcpPort:
    """TCP port for one client at a time; a second one is disconnected at once.

    Host 127.0.0.1 serves clients on this machine, 0.0.0.0 all that reach it; port 0 takes a free one. `url` is the
    link's. A `HardwareError` if the port is taken, or the host is not one of this machine.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        if not 0 <= port <= 65535:
            raise InputError(f"a port is from 0 to 65535; got {port}")
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise cannot_listen("a module", host, port, error) from None
        self._listener.setblocking(False)
        self._client: socket.socket | None = None
        self.url = f"socket://{host}:{self._listener.getsockname()[1]}"

    def files(self) -> list[int]:
        """Return the file descriptors to wait for."""
        return [file.fileno() for file in (self._listener, self._client) if file is not None]

    def connected(self) -> bool:
        """Return whether a client is connected."""
        return self._client is not None

    def receive(self) -> bytes | None:
        """Return the bytes since the last call; None if the client has left since then."""
        content = self._read()
        if content is None:
            self._hang_up()
        if not content:  # else it is not known whether the client has left
            with suppress(BlockingIOError, ConnectionError):  # no newcomer, or one that left again
                newcomer, _ = self._listener.accept()
                if self._client is None:
                    self._client = newcomer
                    newcomer.setblocking(False)
                    newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                else:
                    newcomer.close()
        return content

    def send(self, content: bytes) -> None:
        """Send as much as the client accepts; as over Bluetooth, further bytes are lost."""
        if self._client is not None:
            with suppress(OSError):  # full, or closed, as `receive` will find
                self._client.send(content)

    def close(self) -> None:
        """Close the client and the port."""
        self._hang_up()
        self._listener.close()

    def _read(self) -> bytes | None:
        if self._client is None:
            return b""
        try:
            return self._client.recv(READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


TICK_S, IDLE_TICK_S = 1e-3, 20e-3  # period of steps with a client, and without
# Delay of the server that passes in its modules at once; a longer one must not make them time out.
MAX_LATE_S = 20e-3
PIECE_BYTES = 64  # read by a module at a time, as on the ESP32: answers to more may not fit
FAULT_PATTERN = re.compile(r"(?P<part>[a-z]+)@(?P<when>\d+(\.\d+)?)(?P<unit>ms|s)?")


class PlannedFault(NamedTuple):
    """Part that breaks, and the time in s after the start."""

    part: str
    seconds: float


def parse_fault(text: str) -> PlannedFault:
    """Return the fault of a text such as ``encoder@2s`` or ``supply@800ms``."""
    match = FAULT_PATTERN.fullmatch(text)
    if match is None or match["part"] not in PARTS:
        raise InputError(f"no fault {text!r}; write one of {', '.join(PARTS)} and a time, such as encoder@2s")
    return PlannedFault(match["part"], float(match["when"]) * (1e-3 if match["unit"] == "ms" else 1.0))


class Served(Protocol):
    """What a `Server` serves at a port, until a time in s since the start."""

    port: TcpPort

    def serve(self, now: float) -> None:
        """Run until then."""


class ServedModule:
    """Simulated module at a port, behind a link of given conditions, whose damage has the seed.

    The time of one that is ``in_world`` passes with that of its `World`.
    """

    def __init__(
        self,
        module: SimulatedModule,
        port: TcpPort,
        *,
        conditions: Conditions | None = None,
        seed: int = 0,
        faults: Sequence[PlannedFault] = (),
        in_world: bool = False,
    ) -> None:
        self.module, self.port, self._in_world = module, port, in_world
        conditions = Conditions() if conditions is None else conditions
        self._inbound = Channel(conditions, random.Random(f"in {seed}"))
        self._outbound = Channel(conditions, random.Random(f"out {seed}"))
        self._faults = list(faults)
        self._steps = 0

    def serve(self, now: float) -> None:
        """Run the module and its link until a time, in s since the start."""
        came = self.port.receive()
        if came is None:
            self._outbound.clear()
        if came != b"":
            self._inbound.put(came, now)
        self._advance(now)
        self._listen(now)
        for arrived in self._inbound.take(now):
            if arrived is None:
                self.module.close_link()
                continue
            for begin in range(0, len(arrived), PIECE_BYTES):
                self.module.receive(arrived[begin : begin + PIECE_BYTES])
                self._listen(now)
        for arrived in self._outbound.take(now):
            if arrived:
                self.port.send(arrived)

    def _listen(self, now: float) -> None:
        if content := self.module.transmit():
            self._outbound.put(content, now)

    def _advance(self, now: float) -> None:
        for fault in [fault for fault in self._faults if fault.seconds <= now]:
            self._faults.remove(fault)
            self.module.damage(fault.part)
        if not self._in_world:
            steps = int(now / STEP_S) - self._steps
            self._steps += steps
            self.module.advance(steps * STEP_S)


class Server:
    """Server of simulated modules in real time, by a clock in s.

    All run in one thread; a module needs 3 % of a processor. Steps are due at multiples of the tick, so delays
    do not add up.
    """

    def __init__(self, modules: Sequence[Served], clock: Callable[[], float] = time.perf_counter) -> None:
        self._modules, self._clock = modules, clock
        self._start, self._now = clock(), 0.0

    def files(self) -> list[int]:
        """Return the file descriptors to wait for."""
        return [file for served in self._modules for file in served.port.files()]

    def wait(self) -> float:
        """Return the longest wait for those files until the next step, in s of the clock."""
        return min(max(self._start + self._due() - self._clock(), 0.0), IDLE_TICK_S)

    def step(self) -> None:
        """Let time pass in all modules up to now; the part of a delay beyond `MAX_LATE_S` is lost."""
        now = self._clock() - self._start
        late = max(now - self._due() - MAX_LATE_S, 0.0)
        self._start += late
        self._now = max(now - late, self._now)  # no rounding error takes it back
        for served in self._modules:
            served.serve(self._now)

    def close(self) -> None:
        """Close all ports."""
        for served in self._modules:
            served.port.close()

    def _due(self) -> float:
        tick = TICK_S if any(served.port.connected() for served in self._modules) else IDLE_TICK_S
        return (int(self._now / tick + 1e-6) + 1) * tick


def serve(server: Server, stopped: Callable[[], bool]) -> None:
    """Serve in real time until `stopped` returns True, and close all ports."""
    with closing(server):
        while not stopped():
            select.select(server.files(), [], [], server.wait())
            server.step()
