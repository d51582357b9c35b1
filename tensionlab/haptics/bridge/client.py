"""Client of the bridge, for programs in Python: send a frame, get the state."""

from __future__ import annotations

import json
from contextlib import ExitStack, suppress
from typing import Any, Self

from tensionlab.errors import HardwareError, optional_import
from tensionlab.haptics.bridge.messages import PROTOCOL, BridgeMessage, BridgeState, Welcome, parse_message


class BridgeClient:
    """Client that commands a bridge. A context manager.

    ``url`` is the address that ``tensionlab serve`` prints, such as ``ws://127.0.0.1:8765``. ``welcome`` is the
    first message of the bridge, ``events`` are those that came between the answers. A `HardwareError` says why if
    the bridge cannot be reached, refuses, or has another version of the messages.
    """

    def __init__(self, url: str, token: str | None = None) -> None:
        with optional_import("haptics", "a client of the bridge"):
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import connect
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._stack = ExitStack()
        try:
            socket = connect(f"{url}/command", additional_headers=headers, compression=None)
            self._socket = self._stack.enter_context(socket)
        except (OSError, WebSocketException) as error:
            raise HardwareError(f"{url}: the bridge cannot be reached: {error}") from None
        self.events: list[dict[str, Any]] = []
        with self._stack:  # closed at once if the bridge refuses
            self.welcome = Welcome.model_validate(self._answer("welcome"))
            if self.welcome.protocol != PROTOCOL:
                versions = f"version {self.welcome.protocol} of the messages, this client {PROTOCOL}"
                raise HardwareError(f"{url}: the bridge has {versions}; use the same tensionlab for both")
            self._stack = self._stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def send(self, message: BridgeMessage) -> BridgeState:
        """Send a `Frame` or a `StopRun`; return the state of the rig."""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):  # the last message of the bridge has the reason
            self._socket.send(message.model_dump_json())
        return BridgeState.model_validate(self._answer("state"))

    def frame(
        self,
        time: float,
        hand: tuple[float, ...] | None = None,
        effects: dict[str, dict[str, Any]] | None = None,
        sequence: int = 0,
    ) -> BridgeState:
        """Send the position of the hand (m) at a time (s), and effects; return the state of the rig."""
        bodies = {} if hand is None else {"hand": {"position": hand}}
        table = {"type": "frame", "time": time, "bodies": bodies, "effects": effects, "sequence": sequence}
        return self.send(parse_message(table))

    def _answer(self, kind: str) -> dict[str, Any]:
        from websockets.exceptions import WebSocketException

        while True:
            try:
                message: dict[str, Any] = json.loads(self._socket.recv())
            except WebSocketException as error:
                ended = [event["text"] for event in self.events if event["kind"] == "ended"]
                raise HardwareError(f"the bridge has gone: {ended[-1] if ended else error}") from None
            if message["type"] == "refused":
                raise HardwareError(f"the bridge refused: {message['reason']}")
            if message["type"] == kind:
                return message
            self.events.append(message)
