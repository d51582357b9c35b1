"""The WebSocket of the bridge: one client commands, others watch; what is wrong is refused with a reason."""

from __future__ import annotations

import asyncio
import hmac
import json
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, Self
from urllib.parse import parse_qs, urlsplit

from pydantic import Field, TypeAdapter, ValidationError

from tensionlab.errors import EffectError, HardwareError, MissingDependency
from tensionlab.haptics.bridge.mailbox import Mailbox
from tensionlab.haptics.bridge.messages import LARGEST, Event, Frame, Refused, State, Stop, Welcome

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

COMMAND, EVENTS = "/command", "/events"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
LOCAL_PAGES = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
"""Pages of this machine, which may open the bridge."""
FASTEST = 500.0
"""Messages a second that one client may send; more are a flood."""
BURST = 100
"""Messages that may come at once."""
PATIENCE = 20
"""Messages in a row that may be refused before the connection is."""
STARTING = 10.0
"""How long the server may take to come up, in s."""

READ: TypeAdapter[Frame | Stop] = TypeAdapter(Annotated[Frame | Stop, Field(discriminator="type")])


@dataclass
class Flow:
    """How fast does a client send? A bucket that leaks."""

    level: float = 0.0
    latest: float = field(default_factory=time.monotonic)

    def floods(self) -> bool:
        """Count a message; has it been too many?"""
        now = time.monotonic()
        self.level = max(self.level - (now - self.latest) * FASTEST, 0.0) + 1.0
        self.latest = now
        return self.level > BURST


class Bridge:
    """Serves a mailbox over a WebSocket, by a thread of its own. A context manager.

    Parameters
    ----------
    mailbox : Mailbox
        Gets the frames.
    welcome : Welcome
        Every client's first message.
    state : callable
        Makes the answer to a frame, given its number.
    host, port : str, int
        Where to listen; port 0 takes a free one. Beyond this machine a token must be given.
    token : str, optional
        What a client must know: ``?token=...`` in the URL, or ``Authorization: Bearer ...``.
    pages : sequence of str
        Origins of web pages, besides those of this machine, that may connect.

    Attributes
    ----------
    url : str
        Where clients find it.

    Raises
    ------
    HardwareError
        If it cannot listen there, or may not without a token.
    MissingDependency
        If websockets is not installed.
    """

    def __init__(
        self,
        mailbox: Mailbox,
        welcome: Welcome,
        state: Callable[[int], State],
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        pages: tuple[str, ...] = (),
    ) -> None:
        try:
            import websockets  # noqa: F401
        except ImportError as missing:
            raise MissingDependency(
                'the bridge needs websockets; pip install "tensionlab[haptics]" brings it'
            ) from missing
        if host not in LOOPBACK and not token:
            raise HardwareError(
                f"the bridge would be open to others at {host}; give a token that clients must know"
            )
        self._mailbox, self._welcome, self._state = mailbox, welcome, state
        self._host, self._port, self._token, self._pages = host, port, token, pages
        self._commander: ServerConnection | None = None
        self._clients: set[ServerConnection] = set()
        self._ready = threading.Event()
        self._failure: OSError | None = None
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="bridge", daemon=True)
        self.url = ""

    def __enter__(self) -> Self:
        """Come up."""
        self._thread.start()
        self._ready.wait(STARTING)
        if self._failure is not None or not self.url:
            self._thread.join()
            raise HardwareError(f"the bridge cannot listen at {self._host}, port {self._port}: {self._failure}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close all connections."""
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()

    def tell(self, event: Event) -> None:
        """Send an event to all clients, but rates only to those who watch; from any thread."""
        self._loop.call_soon_threadsafe(self._broadcast, event)

    @property
    def commanded(self) -> bool:
        """Whether a client commands now."""
        return self._commander is not None

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._failure = error
        finally:
            self._loop.close()
            self._ready.set()

    async def _serve(self) -> None:
        from websockets.asyncio.server import serve

        origins: list[Any] = [None, LOCAL_PAGES, *self._pages]
        async with serve(
            self._client,
            self._host,
            self._port,
            origins=origins,
            max_size=LARGEST,
            max_queue=BURST,
            process_request=self._admit,
            compression=None,
        ) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            host = f"[{self._host}]" if ":" in self._host else self._host
            self.url = f"ws://{host}:{port}"
            self._ready.set()
            await self._over.wait()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse who does not know the token, or asks for another path."""
        parts = urlsplit(request.path)
        if self._token is not None:
            bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
            given = parse_qs(parts.query).get("token", [bearer])[0]
            if not hmac.compare_digest(given.encode(), self._token.encode()):
                return connection.respond(HTTPStatus.UNAUTHORIZED, "the token is missing or wrong\n")
        if parts.path not in (COMMAND, EVENTS):
            return connection.respond(HTTPStatus.NOT_FOUND, f"there are {COMMAND} and {EVENTS}\n")
        return None

    async def _client(self, connection: ServerConnection) -> None:
        """Serve a client until it goes."""
        assert connection.request is not None
        commands = urlsplit(connection.request.path).path == COMMAND
        if commands and self._commander is not None:
            await self._turn_away(connection, "another client commands; watch at /events")
            return
        if commands:
            self._commander = connection
        self._clients.add(connection)
        try:
            await connection.send(self._welcome.model_dump_json())
            if commands:
                await self._command(connection)
            else:
                await self._watch(connection)
        finally:
            self._clients.discard(connection)
            if commands:
                self._commander = None

    async def _command(self, connection: ServerConnection) -> None:
        """Answer what a task of its own reads: a flood shows however slow the answers are."""
        from websockets.exceptions import ConnectionClosed

        pending: asyncio.Queue[str | bytes | None] = asyncio.Queue()
        reader, refused = asyncio.create_task(self._read(connection, pending)), 0
        try:
            while (content := await pending.get()) is not None:
                answer = self._answer(content)
                refused = refused + 1 if isinstance(answer, Refused) else 0
                await connection.send(answer.model_dump_json())
                if refused >= PATIENCE:
                    await self._turn_away(connection, f"{PATIENCE} messages in a row could not be understood")
        except ConnectionClosed:
            pass
        finally:
            await reader

    async def _read(self, connection: ServerConnection, pending: asyncio.Queue[str | bytes | None]) -> None:
        """Hand on what comes, until the client goes or floods; then None."""
        from websockets.exceptions import ConnectionClosed

        flow = Flow()
        try:
            async for content in connection:
                if flow.floods():
                    await self._turn_away(connection, f"a flood: at most {FASTEST:g} messages a second")
                    break
                pending.put_nowait(content)
        except ConnectionClosed:
            pass
        finally:
            pending.put_nowait(None)

    async def _watch(self, connection: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            async for _ in connection:
                await self._turn_away(connection, f"this stream is read only; command at {COMMAND}")
                return
        except ConnectionClosed:
            return

    def _answer(self, content: str | bytes) -> State | Refused:
        """Take a message; what to say to it?"""
        try:
            message = READ.validate_python(json.loads(content))
            if isinstance(message, Stop):
                self._mailbox.stop_wanted = True
                return self._state(0)
            self._mailbox.put(message, time.monotonic())
            return self._state(message.sequence)
        except (ValidationError, EffectError, ValueError, RecursionError) as error:
            return Refused(reason=_reason(error))

    async def _turn_away(self, connection: ServerConnection, reason: str) -> None:
        await connection.send(Refused(reason=reason).model_dump_json())
        await connection.close(1008, reason)

    def _broadcast(self, event: Event) -> None:
        from websockets.asyncio.server import broadcast

        clients = self._clients - {self._commander} if event.kind == "rate" else self._clients
        broadcast(clients, event.model_dump_json(exclude_none=True))


def _reason(error: Exception) -> str:
    """Why could a message not be taken? In one line."""
    if isinstance(error, ValidationError):
        problem = error.errors()[0]
        where = ".".join(str(step) for step in problem["loc"] if step not in ("frame", "stop"))
        return f"{where}: {problem['msg']}" if where else problem["msg"]
    if isinstance(error, EffectError):
        return str(error)
    return f"not JSON: {error}"
