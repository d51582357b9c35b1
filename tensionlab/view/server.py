"""Server of the page: viser's, which asks here first who may connect."""

from __future__ import annotations

import contextlib
import io
import logging
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from tensionlab.admission import (
    LOOPBACK,
    Header,
    knows_token,
    loaded_by_other_page,
    names_this_machine,
    same_token,
)
from tensionlab.errors import InputError, needs
from tensionlab.files.reading import brief

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

COOKIE = "tensionlab-view"
"""Name of the cookie in which a browser keeps the token; followed by the port, since ports share cookies."""
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors"
)
HEADERS = {
    "Content-Security-Policy": f"{POLICY} 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
"""Of what a browser gets: it loads nothing from elsewhere, and no other site frames it, but a notebook."""
FRAME = "frame"
"""What the secret is called in the address by which a notebook shows the page in a frame."""
QUIET = logging.getLogger(f"{__name__}.connections")
QUIET.setLevel(logging.CRITICAL)  # whatever connects without being a browser leaves no traceback
_starting = threading.Lock()


@dataclass(frozen=True)
class Gate:
    """Who may open the page and connect to it: pages of this server, and who knows the token if there is one.

    Without a token, the host that was asked for must be this machine by its own name, so that no other page can
    have its name lead here. Other pages may show it in a frame by an address that only this process knows, with
    ``frame`` in it.
    """

    token: str | None = None
    frame: str = field(default_factory=partial(secrets.token_urlsafe, 16))

    def refuse(self, target: str, header: Header) -> str | None:
        """Return why a request is refused; None if it is not. ``target`` is its path and query."""
        host = "".join(header("Host"))
        for origin in header("Origin"):
            if origin.partition("://")[2] != host:
                return f"pages of {brief(origin)} may not connect"
        if loaded_by_other_page(header):
            return "other pages may not load this; open it by its address"
        if self.token is None:
            if names_this_machine(header):
                return None
            return f"the host {brief(host)} is not this machine; open 127.0.0.1"
        if knows_token(target, header, self.token) or same_token(self._cookie(header), self.token):
            return None
        return "the token is missing or wrong; open the address that `tensionlab view` printed"

    @staticmethod
    def _name(header: Header) -> str:
        return f"{COOKIE}-{''.join(header('Host')).rpartition(':')[2]}"

    def _cookie(self, header: Header) -> str:
        try:
            found = SimpleCookie("; ".join(header("Cookie"))).get(self._name(header))
        except CookieError:
            return ""
        return "" if found is None else found.value

    def forward(self, target: str, header: Header) -> dict[str, str] | None:
        """Return the headers that lead a browser from an address with the token to one without; None elsewhere."""
        if self.token is None or "token=" not in urlsplit(target).query:
            return None
        cookie = f"{self._name(header)}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        return {"Location": "/", "Set-Cookie": cookie}

    def answer(
        self, connection: ServerConnection, request: Request, page: Callable[..., Response | None]
    ) -> Response | None:
        """Answer a request: refused, with the page, or not at all if it is one for a WebSocket."""
        header = request.headers.get_all
        if reason := self.refuse(request.path, header):
            return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
        response = page(connection, request)
        if response is None:
            return None
        if forwarded := self.forward(request.path, header):
            response = connection.respond(HTTPStatus.SEE_OTHER, "")
            response.headers.update(forwarded)
        response.headers.update(self.headers(request.path))
        return response

    def headers(self, target: str) -> dict[str, str]:
        """Return the headers of an answer to a request."""
        given = parse_qs(urlsplit(target).query).get(FRAME, [""])[0]
        if not same_token(given, self.frame):
            return HEADERS
        return HEADERS | {"Content-Security-Policy": f"{POLICY} *"}


class PageServer:
    """Running server of a page.

    Attributes
    ----------
    viser : viser.ViserServer
        What draws.
    url : str
        Where the page is, with the token if there is one.
    frame_url : str
        Where it is for a page that shows it in a frame.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen at an address; a free port is taken where it is 0. Beyond this machine, a token is needed.

        Raises
        ------
        InputError
            If nothing can listen there.
        MissingDependency
            If viser is not installed.
        """
        _require_free(host, port)
        gate = Gate(None if host in LOOPBACK else secrets.token_urlsafe(16))
        self.viser = _start(host, port, gate)
        self.viser.scene.configure_default_lights(cast_shadow=False)  # half of the work without a graphics card
        bound = self.viser.get_port()
        name = f"[{host}]" if ":" in host else socket.gethostname() if host in ("0.0.0.0", "::") else host
        self.url = f"http://{name}:{bound}/" + ("" if gate.token is None else f"?token={gate.token}")
        self.frame_url = f"http://{name}:{bound}/?{FRAME}={gate.frame}"

    def close(self) -> None:
        """Close all connections, and listen no longer."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser says so
            self.viser.stop()


def _require_free(host: str, port: int) -> None:
    """Refuse an address at which nothing can listen; viser would take another port, or wait for ever."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        socket.create_server((host, port), family=family).close()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the page cannot be served at {host}, port {port} ({reason}); give another --host or --port"
        ) from None


def _start(host: str, port: int, gate: Gate) -> viser.ViserServer:
    """Start viser's server behind a gate."""
    with needs("view", "the view"):
        import viser
        from viser import _messages
    with _starting, contextlib.redirect_stdout(io.StringIO()), _gated(gate) as gated:  # viser says where it is
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if not gated:
        server.stop()
        raise RuntimeError("this version of viser does not ask who connects; install viser 1.1")
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)  # no tunnel through another's server
    return server


@contextlib.contextmanager
def _gated(gate: Gate) -> Iterator[list[Gate]]:
    """Have viser's server, if it starts in this block, ask a gate; gives a list that is not empty once it does.

    viser has no hook for it, but takes its server from a name of its module, which is another one for a moment.
    """
    import websockets
    import websockets.asyncio.server
    from viser.infra import _infra

    gated: list[Gate] = []

    def serve(*words: Any, process_request: Callable[..., Response | None], **options: Any) -> Any:
        gated.append(gate)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            return gate.answer(connection, request, process_request)

        return websockets.asyncio.server.serve(*words, process_request=answer, logger=QUIET, **options)

    asking = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=serve)),
        datastructures=websockets.datastructures,
        exceptions=websockets.exceptions,
    )
    module: Any = _infra
    original, module.websockets = module.websockets, asking
    try:
        yield gated
    finally:
        module.websockets = original
