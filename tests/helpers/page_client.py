"""A client of a page that is no browser: it connects with the token, and sends what it likes."""

import threading
from contextlib import contextmanager, suppress
from itertools import chain

import msgspec
import zstandard
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

from tests.helpers.browsers import VISER

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0, 0, 1], "fov": 0.7, "near": 0.1, "far": 10,
    "image_height": 800, "image_width": 1280, "look_at": [0, 0, 0], "up_direction": [0, 1, 0],
}  # fmt: skip


class PageClient:
    """Connection to a page."""

    def __init__(self, socket):
        self.socket = socket
        self.send(CAMERA)  # viser reads nothing before it

    def send(self, message):
        """Send a message, packed unless it is bytes."""
        self.socket.send(message if isinstance(message, bytes) else msgspec.msgpack.encode(message))

    def update(self, element, **attributes):
        """Set attributes of an element of the panel."""
        self.send({"type": "GuiUpdateMessage", "uuid": element._impl.uuid, "updates": attributes})

    def elements(self):
        """The identifiers of all elements of the panel, as the page tells them to every browser."""
        found = set()
        for raw in self.socket:
            content = zstandard.decompress(raw[16 : 16 + int.from_bytes(raw[8:16], "little")])
            messages = msgspec.msgpack.decode(content)["messages"]
            found |= {each["uuid"] for each in messages if "uuid" in each}
            if any(each["type"] == "ReplayDoneMessage" for each in messages):
                return sorted(found)


@contextmanager
def joined(url):
    """A client of the page at an address with the token."""
    options = {"max_size": None, "ping_interval": None, "close_timeout": 1.0}  # the server may have ended
    with connect(url.replace("http", "ws", 1), subprotocols=[VISER], **options) as socket:
        yield PageClient(socket)


def attacks(uuid):
    """Messages that would disable an element for all clients, or fill the memory of the server."""
    for name in ("update_cb", "sync_cb", "gui_api", "value", "removed", "props", "parent_container_id"):
        yield {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: []}}
    file = {"source_component_uuid": uuid, "transfer_uuid": uuid}
    whole = {"filename": "x", "mime_type": "x", "part_count": 9, "size_bytes": 9000}
    yield {"type": "FileTransferStartUpload", **whole, **file}
    yield {"type": "FileTransferPart", "part_index": 0, "content": bytes(1000), **file}
    yield {"type": "GuiFormDirtyMessage", "uuid": uuid}
    yield {"type": "GuiRemoveMessage", "uuid": uuid}
    yield bytes(1000)


@contextmanager
def attacked(url):
    """A page while a client that has the token sends it hostile messages as fast as it can; gives how many."""
    ends, sent = threading.Event(), []
    with joined(url) as client:
        elements = client.elements()
    assert elements

    def attack():
        while not ends.is_set():
            with (
                suppress(ConnectionClosed, InvalidHandshake, OSError),
                joined(url) as client,
            ):  # the server may close it
                while not ends.is_set():
                    for message in chain(*map(attacks, elements)):
                        client.send(message)
                        sent.append(1)

    attacker = threading.Thread(target=attack)
    attacker.start()
    try:
        yield sent
    finally:
        ends.set()
        attacker.join()
