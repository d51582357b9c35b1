"""`tensionlab serve` in this process, with its clients, on one simulated clock."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any, Self
from urllib.parse import urlsplit

import pytest
from pythonosc.osc_message_builder import build_msg
from websockets.asyncio.client import connect

import tensionlab.cli.serve  # noqa: F401 - it imports by name what is replaced
from tensionlab.cli import main
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.server import Bridge
from tensionlab.hardware.runner.settings import WorldClock
from tests.helpers.simulated_loop import SimulatedLoop, Turns

HANGS_S = 600.0  # only what hangs takes so long


class SimulatedServe:
    """``tensionlab serve`` in this process: its server, its runner and its clients take turns on one clock.

    Clients may use `BridgeClient`, whose connections are of this kind as well.

    Attributes
    ----------
    url : str
        Where clients find it; empty if it did not start.
    client : ClientState
        What the client that commands has sent.
    """

    url = ""

    def __init__(self, words: tuple[object, ...], monkeypatch: pytest.MonkeyPatch) -> None:
        self.loop = SimulatedLoop()
        for place, part in (
            ("tensionlab.cli.serve.Bridge", partial(LoopBridge, self)),
            ("tensionlab.cli.serve.OscServer", partial(FedOscServer, self)),
            ("tensionlab.cli.serve.ClientState", self._client_state),
            ("tensionlab.cli.common.runs.WorldClock", partial(LoopClock, self)),
            ("websockets.sync.client.connect", self.connect),
            ("time.thread_time", lambda: 0.0),  # reading takes none of the simulated time
        ):
            monkeypatch.setattr(place, part)
        self.turns = Turns(self.loop, lambda: _status([str(word) for word in words]))
        while not (self.url or self.turns.result.done()):
            self.sleep(1e-3)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the run, if it has not ended, and all connections."""
        if not self.turns.result.done():
            self.client.stop_requested = True
            self.wait()
        for task in asyncio.all_tasks(self.loop):
            task.cancel()
        self.sleep(0.0)
        self.loop.close()

    @property
    def now(self) -> float:
        """Time in s."""
        return self.loop.time()

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.loop.run_until_complete(asyncio.sleep(seconds))

    def wait(self) -> int:
        """Let time pass until the run is over; the exit status of the verb."""
        return self.loop.run_until_complete(asyncio.wait_for(asyncio.shield(self.turns.result), HANGS_S))

    def connect(self, url: str, **options: Any) -> Line:
        """Connect a client to the server."""
        return Line(self.loop, url, **options)

    def send_osc(self, address: str, *values: float | str) -> None:
        """Send a message over OSC."""
        self.osc.receive(build_msg(address, values).dgram, "127.0.0.1")

    def _client_state(self, rig: Any) -> ClientState:
        self.client = ClientState(rig, self.loop.time)
        return self.client


def _status(words: list[str]) -> int:
    try:
        main(["serve", *words])
    except SystemExit as left:
        return int(left.code or 0)
    raise AssertionError


class Line:
    """Connection of a client, as `websockets.sync` has them; while it waits, the loop runs.

    Attributes
    ----------
    sent, received : list of str or bytes
        Messages.
    """

    def __init__(self, loop: SimulatedLoop, url: str, **options: Any) -> None:
        self._loop = loop
        self.sent: list[str | bytes] = []
        self.received: list[str | bytes] = []
        self._line = loop.run_until_complete(self._connected(url, options))

    async def _connected(self, url: str, options: dict[str, Any]) -> Any:
        port = urlsplit(url).port
        assert port is not None
        return await connect(url, sock=await self._loop.reach(port), proxy=None, **options)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, content: str | bytes) -> None:
        self.sent.append(content)
        self._loop.run_until_complete(self._line.send(content))

    def recv(self, timeout: float = HANGS_S) -> str | bytes:
        self.received.append(self._loop.run_until_complete(asyncio.wait_for(self._line.recv(), timeout)))
        return self.received[-1]

    def close(self) -> None:
        self._loop.run_until_complete(self._line.close())


class LoopBridge(Bridge):
    """Bridge without a thread: it is served on the simulated loop."""

    def __init__(self, served: SimulatedServe, *given: Any) -> None:
        super().__init__(*given)
        self._served = served

    def __enter__(self) -> Self:
        async def ready() -> None:
            while not (self.url or self._task.done()):
                await asyncio.sleep(0.0)
            if self._task.done():
                self._task.result()

        self._task = self._served.loop.create_task(self.serve())
        self._served.turns.wait(ready())
        self._served.url = self.url.replace("0.0.0.0", "127.0.0.1")
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        self._served.turns.wait(self._task)


class FedOscServer(OscServer):
    """OSC server without a thread: the test hands it what comes."""

    def __init__(self, served: SimulatedServe, *given: Any) -> None:
        super().__init__(*given)
        served.osc = self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._report.finish()


class LoopClock(WorldClock):
    """Clock of simulated modules that go by the loop's time, as they do by real time if they are paced."""

    def __init__(self, served: SimulatedServe, world: Any, **_: Any) -> None:
        super().__init__(world)
        self._served, self._begin = served, served.now - world.time

    def now(self) -> float:
        return self._served.now - self._begin

    def wait_until(self, when: float) -> None:
        self._served.turns.wait(asyncio.sleep(max(when - self.now(), 0.0)))
        super().wait_until(self.now())
