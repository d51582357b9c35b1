"""Event loop of simulated time, its sockets, and blocking functions that take turns with it."""

from __future__ import annotations

import asyncio
import selectors
import socket
import threading
from collections.abc import Awaitable, Callable
from typing import Any


class JumpingSelector(selectors.DefaultSelector):
    """Selector that waits for nothing: where no file is ready, the loop's time jumps to its next timer."""

    now = 100.0

    def select(self, timeout: float | None = None) -> list:
        ready = super().select(0.0)
        if not ready and timeout is None:
            raise RuntimeError("nothing is left to wait for: neither a timer nor a message on its way")
        if not ready:
            self.now += timeout
        return ready


class SocketOfTcp(socket.socket):
    """End of a socket pair that says it were one of a TCP connection."""

    def getpeername(self) -> tuple[str, int]:
        return ("127.0.0.1", 50000)


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Event loop of simulated time.

    Clients reach its servers over socket pairs: what one end sends has arrived at the other at once, which over
    TCP depends on what else the system has to do.
    """

    def __init__(self) -> None:
        self._jumping = JumpingSelector()
        self._factories: dict[int, Callable[[], asyncio.Protocol]] = {}
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    async def create_server(self, factory, host=None, port=None, **options: Any) -> asyncio.Server:
        """Listen as any loop does; clients of this process come through `reach`."""
        server = await super().create_server(factory, host, port, **options)
        self._factories[server.sockets[0].getsockname()[1]] = factory
        return server

    async def reach(self, port: int) -> socket.socket:
        """Return a client's end of a new connection to the server at a port."""
        here, there = socket.socketpair()
        await self.connect_accepted_socket(self._factories[port], SocketOfTcp(fileno=there.detach()))
        return here


class Turns:
    """Blocking function in a thread that only runs while the loop waits for it, and the other way round.

    Parameters
    ----------
    loop : SimulatedLoop
        Begins it at its next turn.
    act : callable
        Calls `wait` where it blocks.

    Attributes
    ----------
    result : Future
        What the function returned or raised.
    """

    def __init__(self, loop: SimulatedLoop, act: Callable[[], Any]) -> None:
        self._loop, self._act = loop, act
        self._its, self._loops = threading.Semaphore(0), threading.Semaphore(0)
        self._outcome: tuple[Any, BaseException | None] | None = None
        self.result: asyncio.Future[Any] = loop.create_future()
        self._thread = threading.Thread(target=self._run, daemon=True)
        loop.call_soon(self._begin)

    def wait(self, awaitable: Awaitable[Any]) -> Any:
        """Let the loop run until something is done; its result. In the thread of the function."""
        task = asyncio.ensure_future(awaitable, loop=self._loop)
        task.add_done_callback(lambda _: self._resume())
        self._loops.release()
        self._its.acquire()
        return task.result()

    def _begin(self) -> None:
        self._thread.start()
        self._its.release()
        self._yield()

    def _resume(self) -> None:
        self._its.release()
        self._yield()

    def _yield(self) -> None:
        """Let the function run, until it waits or ends."""
        self._loops.acquire()
        if self._outcome is None:
            return
        self._thread.join()
        value, error = self._outcome
        if error is None:
            self.result.set_result(value)
        else:
            self.result.set_exception(error)

    def _run(self) -> None:
        self._its.acquire()
        try:
            self._outcome = (self._act(), None)
        except BaseException as error:
            self._outcome = (None, error)
        finally:
            self._loops.release()
