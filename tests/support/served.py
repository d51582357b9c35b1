"""`tensionlab simulate` in this process: its server takes steps while a client waits."""

import contextlib
import io
import socket
import tomllib
from functools import partial

import pytest

from tensionlab.cli import main
from tensionlab.errors import LinkError
from tensionlab.hardware.simulation import serve
from tests.support.simulated_time import SimulatedTime
from tests.support.wire import connected


class PairPort(serve.TcpPort):
    """TCP port that takes clients over socket pairs, too: these carry bytes at once, whatever else runs here."""

    def connect(self) -> socket.socket:
        """Connect a client, and return its end."""
        theirs, self._client = socket.socketpair()
        for end in (theirs, self._client):
            end.setblocking(False)
        return theirs


class ServedLink:
    """A client's link to a port, whose server has time pass while the client waits."""

    lockstep = True

    def __init__(self, url: str, end: socket.socket, simulation: "Simulation") -> None:
        self.url, self._end, self._simulation = url, end, simulation

    def send(self, content: bytes) -> None:
        self._end.sendall(content)
        self._simulation.server.step()

    def receive(self, timeout: float) -> bytes:
        end = self.clock() + timeout
        while not (content := self._read()) and self.clock() < end:
            self._simulation.wait(end - self.clock())
        return content

    def clock(self) -> float:
        return self._simulation.time.monotonic()

    def close(self) -> None:
        self._end.close()
        self._simulation.server.step()

    def _read(self) -> bytes:
        try:
            content = self._end.recv(serve.READ_BYTES)
        except BlockingIOError:
            return b""
        if not content:
            raise LinkError(f"{self.url} was closed by the module")
        return content


class Simulation:
    """Simulated modules as the verb's words make them.

    Attributes
    ----------
    time : SimulatedTime
        That of this computer, which the modules' follows.
    links : dict
        The URLs that were printed, by the modules' names.
    server : Server
    """

    def __init__(self, *words: object) -> None:
        self.time, self._ports, servers = SimulatedTime(), {}, []
        printed = io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
            patch.setattr(serve, "TcpPort", self._open)
            patch.setattr(serve, "Server", partial(serve.Server, clock=self.time.monotonic))
            patch.setattr(serve, "serve", lambda server, stopped: servers.append(server))
            with pytest.raises(SystemExit) as left:
                main(["simulate", *map(str, words)])
        assert not left.value.code
        [self.server] = servers
        self.links = tomllib.loads(printed.getvalue())["modules"]
        self.pass_time(0.01)  # before its first step, a module knows nothing

    def link(self, name: str) -> ServedLink:
        """A new link to a module."""
        url = self.links[name]
        return ServedLink(url, self._ports[url].connect(), self)

    def connected(self, name: str = "module"):
        """A client of a module."""
        return connected(self.link(name))

    def wait(self, seconds: float) -> None:
        """Wait as a server does, for so long at most."""
        self.time.sleep(min(max(self.server.wait(), 1e-6), seconds))
        self.server.step()

    def pass_time(self, seconds: float) -> None:
        """Let time pass while nobody does anything."""
        end = self.time.monotonic() + seconds
        while self.time.monotonic() < end:
            self.wait(end - self.time.monotonic())

    def _open(self, *where: object) -> PairPort:
        port = PairPort(*where)
        self._ports[port.url] = port
        return port
