"""`tensionlab simulate` in this process: its server takes steps while a client waits."""

import contextlib
import importlib
import io
import socket
import tomllib
from contextlib import AbstractContextManager
from functools import partial
from typing import ClassVar

import pytest

from tensionlab.cli import main
from tensionlab.errors import LinkError
from tensionlab.hardware.simulation import serve
from tests.helpers.simulated_time import SimulatedTime
from tests.helpers.wire import Client, connected


class PairPort(serve.TcpPort):
    """TCP port that takes clients over socket pairs, too: these carry bytes at once, whatever else runs here."""

    def connect(self) -> socket.socket:
        """Connect a client, and return its end."""
        theirs, self._client = socket.socketpair()
        for end in (theirs, self._client):
            end.setblocking(False)
        return theirs


class ServedTime(SimulatedTime):
    """Time in which a server takes its steps."""

    server: serve.Server

    def sleep(self, seconds: float) -> None:
        end = self.perf_counter() + seconds
        while (left := end - self.perf_counter()) > 0.0:
            self.step(left)

    def step(self, longest: float) -> None:
        """Wait as the server does, for so long at most, in s."""
        super().sleep(min(max(self.server.wait(), 1e-6), longest))
        self.server.step()


class ServedLink:
    """Client's link to a port, whose server has time pass while the client waits."""

    lockstep = True

    def __init__(self, url: str, end: socket.socket, time: ServedTime) -> None:
        self.url, self._end, self._time = url, end, time

    def send(self, content: bytes) -> None:
        self._end.sendall(content)
        self._time.server.step()

    def receive(self, timeout: float) -> bytes:
        end = self.clock() + timeout
        while not (content := self._read()) and (left := end - self.clock()) > 0.0:
            self._time.step(left)
        return content

    def clock(self) -> float:
        return self._time.perf_counter()

    def close(self) -> None:
        self._end.close()

    def _read(self) -> bytes:
        try:
            content = self._end.recv(serve.READ_BYTES)
        except BlockingIOError:
            return b""
        if not content:
            raise LinkError(f"{self.url} was closed by the module")
        return content


class KeptOpen(contextlib.ExitStack):
    """What the verb opened; it stays open when the verb returns without having served."""

    made: ClassVar[list[contextlib.ExitStack]] = []

    def __exit__(self, kind, error, trace) -> bool:
        if kind is not None:
            return super().__exit__(kind, error, trace)
        self.made.append(self)
        return False

    def close(self) -> None:
        super().__exit__(None, None, None)


class Simulation:
    """Simulated modules as the verb's words make them, and what else it serves.

    Attributes
    ----------
    time : ServedTime
        That of this computer, which the modules' follows.
    printed : str
        On stdout.
    links : dict
        The URLs in it, by the modules' names.
    """

    def __init__(self, *words: object) -> None:
        self.time, self._ports, servers, printed = ServedTime(), {}, [], io.StringIO()
        KeptOpen.made = self._opened = []
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
            patch.setattr(importlib.import_module("tensionlab.cli.simulate"), "ExitStack", KeptOpen)
            patch.setattr(serve, "TcpPort", self._open)
            patch.setattr(serve, "Server", partial(serve.Server, clock=self.time.perf_counter))
            patch.setattr(serve, "serve", lambda server, stopped: servers.append(server))
            with pytest.raises(SystemExit) as left:
                main(["simulate", *map(str, words)])
        assert not left.value.code
        [self.time.server] = servers
        self.printed = printed.getvalue()
        self.links = tomllib.loads(self.printed)["modules"]
        self.time.sleep(0.01)  # before its first step, a module knows nothing

    def connect(self, url: str) -> socket.socket:
        """Connect to a port, and return the client's end."""
        self.time.server.step()  # it sees a client go before the next one comes
        return self._ports[url].connect()

    def link(self, name: str = "module") -> ServedLink:
        """Connect to a module."""
        url = self.links[name]
        return ServedLink(url, self.connect(url), self.time)

    def connected(self, name: str = "module") -> AbstractContextManager[Client]:
        """Return a client of a module, to be closed at the end."""
        return connected(self.link(name))

    def close(self) -> None:
        """Close all that is served."""
        self.time.server.close()
        for stack in self._opened:
            stack.close()

    def _open(self, *where: object) -> PairPort:
        port = PairPort(*where)
        self._ports[port.url] = port
        return port
