"""WebSocket server of the bridge: one client commands, others watch; bad messages are refused with a reason."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Self
from urllib.parse import urlsplit

from tensionlab.errors import (
    MAX_MESSAGE_CHARACTERS,
    HardwareError,
    TensionlabError,
    cannot_listen,
    optional_import,
)
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.command import SILENCE_S, Budget, Commander, FrameRefused
from tensionlab.haptics.bridge.messages import (
    MAX_MESSAGE_BYTES,
    BridgeEvent,
    BridgeState,
    Refused,
    StopRun,
    Welcome,
    parse,
    parse_message,
    refusal_reason,
)
from tensionlab.support import access
from tensionlab.support.files.reading import brief
from tensionlab.support.operating_system import opened_by_other_user

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

COMMAND_PATH, EVENTS_PATH, STATE_PATH = "/command", "/events", "/state"
PAGE_PATH, SCHEMA_PATH = "/", "/schema.json"
MAX_CLIENTS = 32  # simultaneous connections, to command or to watch
STATE_PAGE = Path(__file__).with_name("page.html")
# Headers of documents: they load nothing from elsewhere, and no other page reads or frames them.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Connection": "close",
}
MAX_CLOSE_BYTES = 120  # length of the reason in a closing frame, which has room for 123
MIN_WAIT_S = 0.1  # shortest wait for a message
READ_AHEAD = 16  # messages that are read before their turn
PAUSE_S = 0.02  # delay of a client after each message beyond its budget
CLOSE_TIMEOUT_S = 1.0  # for sending the reason to a client that is rejected
MAX_REFUSED = 20  # refused messages in a row before the connection is closed
START_TIMEOUT_S = 10.0
REFUSAL_PAUSE_S = 0.2  # before a refusal: limits how many of them a browser can cause
STATE_PERIOD_S = 0.1  # period of streamed states

QUIET = logging.getLogger(f"{__name__}.connections")
QUIET.setLevel(logging.CRITICAL)  # a connection that speaks no WebSocket leaves no traceback


@dataclass(frozen=True)
class Admission:
    """Rules by which clients are admitted, and the documents for a browser."""

    token: str | None = None  # what a client must know
    pages: tuple[str, ...] = ()  # origins of web pages, besides those of this machine, that may connect
    schema: str = ""  # JSON Schema of the messages

    def refuse(self, target: str, values: access.Header, clients: int) -> tuple[HTTPStatus, str] | None:
        """Return why a request is refused; None if it is not.

        Without a token, a page must be of this machine and must call it by its own name: another page can neither
        connect itself nor have its name lead here (DNS rebinding). ``target`` is path and query, ``values``
        returns the values of a header, ``clients`` is the number of connections.
        """
        for origin in values("Origin"):
            if not access.LOCAL_PAGES.fullmatch(origin) and origin not in self.pages:
                problem = f"pages of {brief(origin)} may not connect, unless it is given to --page"
                return HTTPStatus.FORBIDDEN, problem
        if access.loaded_by_other_page(values):
            return HTTPStatus.FORBIDDEN, "other pages may not load this; open it by its address"
        if self.token is not None:
            if not access.knows_token(target, values, self.token):
                return HTTPStatus.UNAUTHORIZED, "the token is missing or wrong"
        elif not access.names_this_machine(values):
            problem = f"the host {brief(''.join(values('Host')))} is not this machine; connect to 127.0.0.1"
            return HTTPStatus.FORBIDDEN, f"{problem}, or serve with a token"
        known = (PAGE_PATH, COMMAND_PATH, EVENTS_PATH, STATE_PATH, SCHEMA_PATH)
        if (path := urlsplit(target).path) not in known:
            return HTTPStatus.NOT_FOUND, f"nothing is at {brief(path)}; there are {', '.join(known)}"
        if clients >= MAX_CLIENTS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_CLIENTS} clients are connected already"
        return None

    def document(self, target: str) -> tuple[str, bytes] | None:
        """Return the type and content of the state page or the schema; None for other targets."""
        path = urlsplit(target).path
        if path == PAGE_PATH:
            return "text/html; charset=utf-8", STATE_PAGE.read_bytes()
        return ("application/schema+json", self.schema.encode()) if path == SCHEMA_PATH else None


@dataclass
class CommandConnection:
    """Connection of the client in command, its budget, and what to answer; None at the end."""

    socket: ServerConnection
    commander: Commander
    budget: Budget = field(default_factory=Budget)
    pending: asyncio.Queue[str | bytes | Refused | None] = field(default_factory=asyncio.Queue)


class Bridge:
    """WebSocket server of the bridge, with its own thread. A context manager; ``url`` is its address.

    Frames go to the client state; ``state`` returns the answer to a frame, given its number. It listens at a host
    and port; port 0 takes a free one. ``report`` is called with a line when a client connects, leaves or is
    refused, from any thread. A `HardwareError` if it cannot listen there, or beyond this machine without a token.
    """

    def __init__(
        self,
        client: ClientState,
        welcome: Welcome,
        state: Callable[[int], BridgeState],
        host: str = "127.0.0.1",
        port: int = 0,
        admission: Admission | None = None,
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        with optional_import("haptics", "the bridge"):
            from websockets.exceptions import ConnectionClosed
        self._closed = ConnectionClosed  # raised when a client has gone
        self._admission = admission or Admission()
        if host not in access.LOOPBACK and not self._admission.token:
            raise HardwareError(f"the bridge would be open to others at {host}; give a token (--token-file)")
        self._client, self._welcome, self._state = client, welcome, state
        self._host, self._port, self._report = host, port, report
        client.command.report = report
        self._commanding: CommandConnection | None = None
        self._clients: set[ServerConnection] = set()
        self._ready = threading.Event()
        self._failure: OSError | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="bridge", daemon=True)
        self.url = ""

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait(START_TIMEOUT_S)
        if self._failure is not None or not self.url:
            self._thread.join()
            raise cannot_listen("the bridge", self._host, self._port, self._failure or "no answer")
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        self._thread.join()

    def close(self) -> None:
        """End `serve`; from any thread."""
        self._call_in_loop(self._over.set)

    def broadcast(self, event: BridgeEvent) -> None:
        """Send an event to all clients, but rates only to those that watch; from any thread."""

        def send() -> None:
            from websockets.asyncio.server import broadcast

            commanding = {self._commanding.socket} if self._commanding is not None else set()
            clients = self._clients - commanding if event.kind == "rate" else self._clients
            broadcast(clients, event.model_dump_json(exclude_none=True))

        self._call_in_loop(send)

    def _call_in_loop(self, act: Callable[[], object]) -> None:
        assert self._loop is not None
        self._loop.call_soon_threadsafe(act)

    def _run(self) -> None:
        try:
            asyncio.run(self.serve())
        except OSError as error:
            self._failure = error
        finally:
            self._ready.set()

    async def serve(self) -> None:
        """Serve clients in the running event loop, until `close`; the context manager does so in a thread."""
        from websockets.asyncio.server import serve

        self._loop = asyncio.get_running_loop()
        async with serve(
            self._serve_client,
            self._host,
            self._port,
            max_size=MAX_MESSAGE_BYTES,
            max_queue=READ_AHEAD,
            process_request=self._admit,
            logger=QUIET,
            compression=None,
        ) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            host = f"[{self._host}]" if ":" in self._host else self._host
            self.url = f"ws://{host}:{port}"
            self._ready.set()
            await self._over.wait()

    async def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse a client that may not connect; answer a browser that asks for a document."""
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        refused = self._admission.refuse(request.path, request.headers.get_all, len(self._clients))
        ends = connection.remote_address, connection.local_address
        if self._admission.token is None and opened_by_other_user(*ends):
            refused = HTTPStatus.FORBIDDEN, "another user's programs need a token; serve with one (--token-file)"
        if refused:
            status, reason = refused
            await asyncio.sleep(REFUSAL_PAUSE_S)
            self._report(f"{_name(connection)}: refused: {reason}")
            return connection.respond(status, f"{reason}\n")
        document = self._admission.document(request.path)
        if document is None:
            return None
        kind, content = document
        headers = Headers({**HEADERS, "Content-Type": kind, "Content-Length": str(len(content))})
        return Response(HTTPStatus.OK, HTTPStatus.OK.phrase, headers, content)

    async def _serve_client(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        path, name = urlsplit(connection.request.path).path, _name(connection)
        if path == COMMAND_PATH:
            if refused := await self._accept_command(connection):
                self._report(f"{name}: refused: {refused}")
                return
        else:
            self._report(f"{name}: watches {path}")
            await self._watch(connection, states=path == STATE_PATH)
        reason = f": {connection.close_reason}" if connection.close_reason else ""
        self._report(f"{name}: has gone{reason}")

    async def _accept_command(self, connection: ServerConnection) -> str:
        """Let a client command until it leaves, if no other one does; return why not, or an empty string."""
        loop = asyncio.get_running_loop()

        def on_dismissed(reason: str) -> None:
            asyncio.run_coroutine_threadsafe(self._reject(connection, reason), loop)

        command, previous_connection = self._client.command, self._commanding
        if previous_connection is not None and previous_connection.socket.state.name != "OPEN":
            command.leave(previous_connection.commander)  # it has gone, and its task has not run since
        try:
            commander = command.take(_name(connection), self._client.clock(), on_dismissed)
        except FrameRefused as refused:
            await self._reject(connection, str(refused))
            return str(refused)
        connected = self._commanding = CommandConnection(connection, commander)
        self._clients.add(connection)
        try:
            await connection.send(self._welcome.model_dump_json())
            await self._command(connected)
        finally:
            self._clients.discard(connection)
            command.leave(commander)
            if self._commanding is connected:
                self._commanding = None
        return ""

    async def _command(self, connected: CommandConnection) -> None:
        """Answer the messages that a task of its own reads: so a flood shows, however slow the answers are."""
        socket, refused = connected.socket, 0
        reader = asyncio.create_task(self._read(connected))
        try:
            while True:
                silent = self._client.clock() - connected.commander.last_seen
                content = await asyncio.wait_for(connected.pending.get(), max(SILENCE_S - silent, MIN_WAIT_S))
                if content is None:
                    break
                answer = content if isinstance(content, Refused) else self._answer(content, connected)
                refused = refused + 1 if isinstance(answer, Refused) else 0
                await asyncio.wait_for(socket.send(answer.model_dump_json()), SILENCE_S)
                if isinstance(answer, Refused) and refused >= MAX_REFUSED:
                    await self._reject(socket, f"{MAX_REFUSED} messages in a row refused: {answer.reason}")
        except TimeoutError:
            await self._reject(socket, f"silent for {SILENCE_S:g} s: no frame that could be taken")
        except self._closed:
            pass
        finally:
            await reader

    async def _read(self, connected: CommandConnection) -> None:
        """Queue the messages, until the client leaves or exceeds its budget for long; then None."""
        refused = 0
        try:
            async for content in connected.socket:
                reason = connected.budget.refuse(len(content), self._client.clock())
                # Slow reading leaves room for some messages in between: only a calm client starts afresh.
                refused = 0 if connected.budget.calm else refused + bool(reason)
                if refused >= MAX_REFUSED:
                    connected.socket.transport.pause_reading()
                    await self._reject(connected.socket, reason)
                    break
                connected.pending.put_nowait(Refused(reason=reason) if reason else content)
                if reason:
                    await asyncio.sleep(PAUSE_S)
        except self._closed:
            pass
        finally:
            connected.pending.put_nowait(None)

    async def _watch(self, connection: ServerConnection, *, states: bool) -> None:
        """Send events and, if desired, states, until the client leaves."""
        self._clients.add(connection)
        try:
            await connection.send(self._welcome.model_dump_json())
            while True:
                try:
                    await asyncio.wait_for(connection.recv(), STATE_PERIOD_S if states else None)
                except TimeoutError:
                    await connection.send(self._state(0).model_dump_json())
                else:
                    await self._reject(connection, f"this stream is read only; command at {COMMAND_PATH}")
                    return
        except self._closed:
            pass
        finally:
            self._clients.discard(connection)

    def _answer(self, content: str | bytes, connected: CommandConnection) -> BridgeState | Refused:
        now, began = self._client.clock(), time.thread_time()
        try:
            message = parse_message(parse(content))
            if isinstance(message, StopRun):
                self._client.stop(now, connected.commander)
                return self._state(0)
            self._client.put(message, now, connected.commander)
            return self._state(message.sequence)
        except TensionlabError as error:
            return Refused(reason=refusal_reason(error))
        except Exception as error:  # unforeseen: no message ends the bridge
            logging.getLogger(__name__).exception("a message of %s", connected.commander.name)
            return Refused(reason=refusal_reason(error))
        finally:
            connected.budget.add_reading(time.thread_time() - began, now)

    async def _reject(self, connection: ServerConnection, reason: str) -> None:
        """Send the reason, and close; a client that does not read is cut off."""
        try:
            async with asyncio.timeout(CLOSE_TIMEOUT_S):
                await connection.send(Refused(reason=reason[:MAX_MESSAGE_CHARACTERS]).model_dump_json())
                await connection.close(1008, reason.encode()[:MAX_CLOSE_BYTES].decode(errors="ignore"))
        except self._closed:
            pass
        except TimeoutError:
            connection.transport.abort()


def _name(connection: ServerConnection) -> str:
    host, port, *_ = connection.remote_address
    return f"{host}, port {port}"
