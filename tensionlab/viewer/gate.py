"""Gate in front of viser: who may connect, and which messages of a browser pass.

This is the only file that touches viser's inside. viser sets whatever attribute a message names, takes uploads for
any element and has no hook for who connects, so all of that is decided here before viser sees it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http import HTTPStatus
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal
from urllib.parse import quote, urlencode, urlsplit

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from tensionlab.errors import optional_import
from tensionlab.support.access import Header, knows_token, loaded_by_other_page, names_this_machine
from tensionlab.support.files.reading import brief

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HEADERS = {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers of every page: it loads nothing from elsewhere, and its address goes nowhere."""
PAGE_PATH, STOP_PATH = "/", "/stop"
MAX_MESSAGE_BYTES = 1 << 14  # longest message of a browser
# Browsers at a time, and connections without a request; beyond, the oldest of those is closed.
MAX_CLIENTS, MAX_WAITING = 32, 256
MAX_TEXT = 1000  # longest text that a browser may enter, in characters
STOP_BUTTON = (
    '<div style="position:fixed;left:16px;bottom:16px;z-index:100000;font:bold 18px sans-serif">'
    '<div style="color:#d00000;background:#fff;max-width:40em;white-space:pre-line"></div>'
    '<button style="font:inherit;padding:14px 24px;border:0;border-radius:4px;color:#fff;background:#d00000" '
    "onclick=\"fetch('/stop'+location.search).then(a=>a.ok?'':a.text(),"
    "()=>'NOT STOPPED: the server of this page does not answer; end the run itself')"
    '.then(t=>this.previousElementSibling.textContent=t)">STOP ALL MODULES</button></div>'
)
"""Button outside of what viser draws: it works while viser's connection or its panel does not."""
QUIET = logging.getLogger(f"{__name__}.connections")
QUIET.setLevel(logging.CRITICAL)  # a caller that is no browser leaves no traceback

# Messages that a browser may send


Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=0, le=100_000)]
Text = Annotated[str, Field(max_length=MAX_TEXT)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Point = Annotated[list[Number], Field(min_length=2, max_length=2)]


class BrowserMessage(BaseModel):
    """BrowserMessage of a browser; a subclass has the fields of viser's message of its type."""

    model_config = ConfigDict(extra="forbid", strict=True)

    def concerns(self, server: viser.ViserServer) -> bool:
        """Tell whether the message is about something that is on the page."""
        return True


class FieldValue(BaseModel):
    """The one attribute of an element that a browser may set."""

    model_config = ConfigDict(extra="forbid", strict=True)
    value: bool | Number | Text | Annotated[list[Number], Field(max_length=3)]


class GuiUpdate(BrowserMessage):
    """Value entered in a field, or press of a button."""

    type: Literal["GuiUpdateMessage"]
    uuid: Text
    updates: FieldValue

    def concerns(self, server: viser.ViserServer) -> bool:
        """Tell whether the element is there and can have the value."""
        element = server.gui._gui_input_handle_from_uuid.get(self.uuid)
        return element is not None and can_have(element, self.updates.value)


class Shortcut(BrowserMessage):
    """Keyboard shortcut."""

    type: Literal["CommandTriggerMessage"]
    uuid: Text


class CameraUpdate(BrowserMessage):
    """Camera of a browser."""

    type: Literal["ViewerCameraMessage"]
    wxyz: Quaternion
    position: Vector
    fov: Number
    near: Number
    far: Number
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class NodeMessage(BrowserMessage):
    """BrowserMessage about a node of the scene, by its name."""

    name: Text
    owner: Literal[""] = ""

    def concerns(self, server: viser.ViserServer) -> bool:
        """Tell whether there is a node of that name."""
        return self.name in server.scene._handle_from_node_name


class NodeClick(NodeMessage):
    """Click on a node."""

    type: Literal["SceneNodeClickMessage"]
    instance_index: int | None
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: Point
    modifier: Text | None


class NodeDrag(NodeMessage):
    """Drag of a node."""

    type: Literal["SceneNodeDragMessage"]
    phase: Literal["start", "update", "end"]
    instance_index: int | None
    start_position: Vector
    start_screen_pos: Point
    end_position: Vector
    end_screen_pos: Point
    button: Literal["left", "middle", "right"]
    modifier: Text | None


class HandleDrag(NodeMessage):
    """Begin or end of a drag of the handle with arrows."""

    type: Literal["TransformControlsDragStartMessage", "TransformControlsDragEndMessage"]


class HandlePose(NodeMessage):
    """Pose of the handle with arrows."""

    type: Literal["TransformControlsUpdateMessage"]
    wxyz: Quaternion
    position: Vector


MESSAGES: TypeAdapter[BrowserMessage] = TypeAdapter(
    Annotated[
        GuiUpdate | Shortcut | CameraUpdate | NodeClick | NodeDrag | HandleDrag | HandlePose,
        Field(discriminator="type"),
    ]
)


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


# Who may connect


@dataclass
class Gate:
    """Rules by which requests and messages pass.

    Attributes
    ----------
    token : str
        What a request must have, for the page, the stop and the WebSocket alike.
    local : bool
        Whether the page is for this machine alone, and so must be called by this machine's own name.
    stop : callable or None
        What a request for `STOP_PATH` calls: it returns whether all has stopped, and what to say.
    server : viser.ViserServer or None
        What messages are for, once it runs.
    waiting, clients : dict and set of ServerConnection
        Connections without a request yet, the oldest first; and those of browsers.
    """

    token: str
    local: bool = True
    stop: Callable[[], tuple[bool, str]] | None = None
    server: viser.ViserServer | None = None
    waiting: dict[ServerConnection, None] = field(default_factory=dict)
    clients: set[ServerConnection] = field(default_factory=set)

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
            if len(self.clients) >= MAX_CLIENTS:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_CLIENTS} browsers are here\n")
            self.clients.add(connection)
            return None
        if forwarded := self.forward(request.path, header):
            response = connection.respond(HTTPStatus.SEE_OTHER, "")
            response.headers["Location"] = forwarded
        elif self.stop is not None and urlsplit(request.path).path == PAGE_PATH:
            response.body = response.body.replace(b"</body>", STOP_BUTTON.encode() + b"</body>")
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        response.headers.update(HEADERS)
        return response

    def forward(self, target: str, header: Header) -> str | None:
        """Return where the page has its WebSocket in its address, with the token; None if it is there.

        viser connects to the address in ``websocket``. A cookie would not do: browsers send it to all servers of
        this machine, those of other users too.
        """
        if "websocket=" in urlsplit(target).query:
            return None
        socket = f"ws://{''.join(header('Host'))}/?token={quote(self.token)}"
        return f"{PAGE_PATH}?{urlencode({'token': self.token, 'websocket': socket})}"

    def came(self, connection: ServerConnection) -> None:
        """Note a new connection; close the oldest one without a request if there are too many."""
        self.waiting[connection] = None
        if len(self.waiting) > MAX_WAITING:
            oldest = next(iter(self.waiting))
            del self.waiting[oldest]
            oldest.transport.abort()

    def left(self, connection: ServerConnection) -> None:
        """Forget a connection."""
        self.waiting.pop(connection, None)
        self.clients.discard(connection)

    def admitted(self, raw: object) -> bytes | None:
        """Return a message as viser gets it; None if it does not pass.

        It is written anew, so that viser cannot read it otherwise than it was read here.
        """
        if not isinstance(raw, bytes) or self.server is None:
            return None
        import msgspec

        try:
            message = MESSAGES.validate_python(msgspec.msgpack.decode(raw))
        except (ValueError, RecursionError):
            return None
        return msgspec.msgpack.encode(message.model_dump()) if message.concerns(self.server) else None


def start(host: str, port: int, gate: Gate) -> viser.ViserServer:
    """Start viser's server behind a gate."""
    with optional_import("view", "the view"):
        import viser
    with _gated(gate) as gated:
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if not gated:
        server.stop()
        raise RuntimeError("this version of viser does not ask who connects; install viser 1.1")
    gate.server = server
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

    class Connection(websockets.asyncio.server.ServerConnection):
        """Connection that the gate knows of, and that gives viser only the messages that pass."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            gate.came(self)

        def connection_lost(self, exc: Exception | None) -> None:
            gate.left(self)
            super().connection_lost(exc)

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                if (admitted := gate.admitted(await super().recv(decode))) is not None:
                    return admitted

    def serve(*words: Any, process_request: Callable[..., Response | None], **options: Any) -> Any:
        gated.append(gate)

        async def answer(connection: ServerConnection, request: Request) -> Response | None:
            return await gate.answer(connection, request, process_request)

        options |= {"max_size": MAX_MESSAGE_BYTES, "create_connection": Connection, "logger": QUIET}
        return websockets.asyncio.server.serve(*words, process_request=answer, **options)

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
