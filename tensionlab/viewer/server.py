"""Server of a page: viser's, behind a gate that decides who may connect and which messages pass.

This is the only file that touches viser's inside. viser sets whatever attribute a message names, takes uploads for
any element and has no hook for who connects, so all of that is decided here before viser sees it.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import os
import secrets
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal
from urllib.parse import quote, urlencode, urlsplit

from pydantic import BaseModel, ConfigDict, Field, create_model

from tensionlab.errors import InputError, optional_import
from tensionlab.support.access import LOOPBACK, Header, knows_token, loaded_by_other_page, names_this_machine
from tensionlab.support.files.reading import brief
from tensionlab.viewer.html import render

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

# Of every page: it loads nothing from elsewhere, and its address goes nowhere.
HEADERS = {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
PAGE_PATH, STOP_PATH = "/", "/stop"
MAX_MESSAGE_BYTES = 1 << 14  # longest message of a browser
MAX_WAITING = 256  # connections without a request; beyond, the oldest is closed, so that the stop is reached
MAX_TEXT = 1000  # longest text that a browser may enter, in characters
PANEL_PIXELS = 410.0
QUIET = logging.getLogger(f"{__name__}.connections")
QUIET.setLevel(logging.CRITICAL)  # a caller that is no browser leaves no traceback
_starting = threading.Lock()


def _model(name: str, fields: dict[str, Any]) -> type[BaseModel]:
    """Return a model of messages that have these fields, and no others."""
    definitions: Any = {field: (kind, ...) for field, kind in fields.items()}
    return create_model(name, __config__=ConfigDict(extra="forbid", strict=True), **definitions)


Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=0, le=100_000)]
Text = Annotated[str, Field(max_length=MAX_TEXT)]
Point, Vector, Quaternion = (Annotated[list[Number], Field(min_length=k, max_length=k)] for k in (2, 3, 4))
Value = bool | Number | Text | Annotated[list[Number], Field(max_length=3)]
NODE = {"name": Text, "owner": Text}
PICK = NODE | {"instance_index": int | None, "modifier": Text | None}
FIELDS: dict[str, dict[str, Any]] = {
    "GuiUpdateMessage": {"uuid": Text, "updates": _model("Updates", {"value": Value})},
    "CommandTriggerMessage": {"uuid": Text},
    "ViewerCameraMessage": {
        "wxyz": Quaternion,
        **dict.fromkeys(("position", "look_at", "up_direction"), Vector),
        **dict.fromkeys(("fov", "near", "far"), Number),
        **dict.fromkeys(("image_height", "image_width"), Pixels),
    },
    "SceneNodeClickMessage": PICK | {"ray_origin": Vector, "ray_direction": Vector, "screen_pos": Point},
    "SceneNodeDragMessage": PICK
    | {"phase": Literal["start", "update", "end"], "button": Literal["left", "middle", "right"]}
    | {"start_position": Vector, "start_screen_pos": Point, "end_position": Vector, "end_screen_pos": Point},
    "TransformControlsDragStartMessage": NODE,
    "TransformControlsDragEndMessage": NODE,
    "TransformControlsUpdateMessage": NODE | {"wxyz": Quaternion, "position": Vector},
}  # of the messages that a browser may send, by viser's names for them
MESSAGES = {name: _model(name, fields) for name, fields in FIELDS.items()}


def can_have(element: Any, value: bool | float | str | list[float]) -> bool:
    """Tell whether an element of the panel can have a value: its kind, length and range, or one of its options."""
    now = element.value
    options = getattr(element, "options", None)
    if options is not None:
        return value in options
    if isinstance(now, (bool, str)):
        return type(value) is type(now)
    if isinstance(now, tuple):
        return isinstance(value, list) and len(value) == len(now)
    if not isinstance(now, (int, float)) or not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    low, high = getattr(element, "min", None), getattr(element, "max", None)
    return (low is None or low <= value) and (high is None or value <= high)


@dataclass
class Gate:
    """Rules by which requests and messages pass."""

    token: str  # needed for the page, the stop and the WebSocket alike
    local: bool = True  # whether the page is for this machine alone, and must be called by its own name
    stop: Callable[[], tuple[bool, str]] | None = None  # returns whether all has stopped, and what to say
    server: viser.ViserServer | None = None  # once it runs
    waiting: dict[ServerConnection, None] = field(default_factory=dict)  # without a request yet, the oldest first

    def refuse(self, target: str, header: Header) -> str | None:
        """Return why a request is refused; None if it is not. ``target`` is its path and query."""
        host = "".join(header("Host"))
        for origin in header("Origin"):
            if origin.partition("://")[2] != host:
                return f"pages of {brief(origin)} may not connect"
        if loaded_by_other_page(header):
            return "other pages may not load this; open it by its address"
        if self.local and not names_this_machine(header):
            return f"the host {brief(host)} is not this machine; open 127.0.0.1"
        if knows_token(target, header, self.token):
            return None
        return "the token is missing or wrong; open the address that was printed, with its token"

    async def answer(
        self, connection: ServerConnection, request: Request, page: Callable[..., Response | None]
    ) -> Response | None:
        """Answer a request: refused, with the page, by stopping, or not at all if it is for a WebSocket."""
        header = request.headers.get_all
        self.waiting.pop(connection, None)
        if reason := self.refuse(request.path, header):
            return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
        if urlsplit(request.path).path == STOP_PATH and self.stop is not None:
            stopped, text = await asyncio.to_thread(self.stop)
            return connection.respond(HTTPStatus.OK if stopped else HTTPStatus.SERVICE_UNAVAILABLE, f"{text}\n")
        if "Accept-Encoding" in request.headers:
            del request.headers["Accept-Encoding"]  # so that the button can be put into the page
        response = page(connection, request)
        if response is None:
            return None
        if location := self.redirect(request.path, header):
            response = connection.respond(HTTPStatus.SEE_OTHER, "")
            response.headers["Location"] = location
        elif self.stop is not None and urlsplit(request.path).path == PAGE_PATH:
            response.body = response.body.replace(b"</body>", render("run.stop_button").encode() + b"</body>")
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        response.headers.update(HEADERS)
        return response

    def redirect(self, target: str, header: Header) -> str | None:
        """Return the address of the page with that of its WebSocket, to which viser connects; None if it has it.

        A cookie would not do: browsers send it to all servers of this machine, those of other users too.
        """
        if "websocket=" in urlsplit(target).query:
            return None
        socket = f"ws://{''.join(header('Host'))}/?token={quote(self.token)}"
        return f"{PAGE_PATH}?{urlencode({'token': self.token, 'websocket': socket})}"

    def admit(self, raw: object) -> bytes | None:
        """Return a message as viser gets it; None if it does not pass.

        It is written anew, so that viser cannot read it otherwise than it was read here.
        """
        if not isinstance(raw, bytes) or self.server is None:
            return None
        import msgspec

        try:
            fields = msgspec.msgpack.decode(raw, type=dict[str, Any])
            name = fields.pop("type", "")
            message: Any = MESSAGES[name].model_validate(fields)
        except (ValueError, RecursionError, KeyError, TypeError):
            return None
        if name == "GuiUpdateMessage":
            element = self.server.gui._gui_input_handle_from_uuid.get(message.uuid)
            if element is None or not can_have(element, message.updates.value):
                return None
        return msgspec.msgpack.encode({"type": name} | message.model_dump())


class PageServer:
    """Server of a page, ``viser``, behind its ``gate``; ``url`` is its address with the token."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen at an address, at a free port for 0; InputError if nothing can listen there."""
        try:  # viser would take another port, or wait endlessly
            socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(
                f"the page cannot be served at {host}, port {port} ({reason}); give another --host or --port"
            ) from None
        self._opened: Path | None = None
        self.gate = Gate(secrets.token_urlsafe(16), local=host in LOOPBACK)
        with _starting, contextlib.redirect_stdout(io.StringIO()):  # viser prints its address
            self.viser = self.gate.server = _start_viser(host, port, self.gate)
        # Without a graphics card, shadows are half of the work, and preparing reflections is ten seconds of it.
        self.viser.scene.configure_default_lights(cast_shadow=False)
        self.viser.scene.configure_environment_map(None)
        gui = self.viser.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()  # next to the picture, so that neither hides the other
        gui.main_panel.set_width(PANEL_PIXELS)
        gui.add_html(render("common.style"))
        name = f"[{host}]" if ":" in host else socket.gethostname() if host in ("0.0.0.0", "::") else host
        self.url = f"http://{name}:{self.viser.get_port()}/?token={self.gate.token}"

    def open_browser(self) -> None:
        """Open a browser at the page, by a file that only this user can read, until a browser connects.

        All users see what programs are called with, so no browser is called with the token. The file is not in a
        hidden or temporary folder, which browsers in containers cannot read.
        """
        handle, name = tempfile.mkstemp(".html", "tensionlab-view-", Path.home())
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f'<meta http-equiv="refresh" content="0;url={self.url}">\n')
        self._opened = Path(name)
        self.viser.on_client_connect(lambda _: self._remove_opened())
        webbrowser.open(self._opened.as_uri())

    def _remove_opened(self) -> None:
        if self._opened is not None:
            self._opened.unlink(missing_ok=True)

    def close(self) -> None:
        """Close all connections, and stop listening."""
        self._remove_opened()
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints that it stops
            self.viser.stop()


def _gated_connection(gate: Gate) -> type[ServerConnection]:
    """Return the class of connections behind a gate."""
    from websockets.asyncio.server import ServerConnection

    class Connection(ServerConnection):
        """Connection that the gate knows of, and that gives viser only the messages that pass."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            gate.waiting[self] = None
            if len(gate.waiting) > MAX_WAITING:
                oldest = next(iter(gate.waiting))
                del gate.waiting[oldest]
                oldest.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            gate.waiting.pop(self, None)
            super().connection_lost(exc)

        async def recv(self, decode: bool | None = None) -> Any:
            while (message := gate.admit(await super().recv(decode))) is None:
                pass
            return message

    return Connection


def _start_viser(host: str, port: int, gate: Gate) -> viser.ViserServer:
    """Start viser's server behind a gate.

    viser has no hook for it, but takes its server from a name of its module, which is replaced while it starts.
    """
    with optional_import("view", "the view"):
        import viser
    import websockets
    import websockets.asyncio.server
    from viser.infra import _infra

    gated = False

    def serve(*words: Any, process_request: Callable[..., Response | None], **options: Any) -> Any:
        nonlocal gated
        gated = True

        async def answer(connection: ServerConnection, request: Request) -> Response | None:
            return await gate.answer(connection, request, process_request)

        options |= {"max_size": MAX_MESSAGE_BYTES, "create_connection": _gated_connection(gate), "logger": QUIET}
        return websockets.asyncio.server.serve(*words, process_request=answer, **options)

    module: Any = _infra
    module.websockets = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=serve)),
        datastructures=websockets.datastructures,
        exceptions=websockets.exceptions,
    )
    try:
        server = viser.ViserServer(host=host, port=port, verbose=False)
    finally:
        module.websockets = websockets
    if not gated:
        server.stop()
        raise RuntimeError("this version of viser does not ask who connects; install viser 1.1")
    return server


def on_input(field: Any, act: Callable[[], None]) -> Any:
    """Call a function when something is entered in a browser, but not when the page shows it there."""

    async def changed(event: Any) -> None:
        if event.client is not None:
            act()

    field.on_update(changed)
    return field


def on_press(element: Any, act: Callable[[], None]) -> None:
    """Call a function when a button or a keyboard shortcut is pressed in a browser."""

    async def pressed(event: Any) -> None:
        act()

    (element.on_trigger if hasattr(element, "on_trigger") else element.on_click)(pressed)
