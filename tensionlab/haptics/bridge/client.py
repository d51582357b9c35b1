"""A client of the bridge, for programs in Python: send a frame, get the state."""

from __future__ import annotations

import json
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, Self

from tensionlab.errors import HardwareError, MissingDependency
from tensionlab.haptics.bridge.messages import Frame, Message, State, Welcome


class BridgeClient:
    """Commands a bridge. A context manager.

    Parameters
    ----------
    url : str
        As `tensionlab serve` prints it, such as ``ws://127.0.0.1:8765``.
    token : str, optional
        If the bridge asks for one.

    Attributes
    ----------
    welcome : Welcome
        What the bridge said first.
    events : list of dict
        Events that came between the answers.

    Raises
    ------
    HardwareError
        If the bridge cannot be reached, or refuses; says why.
    """

    def __init__(self, url: str, token: str | None = None) -> None:
        try:
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import connect
        except ImportError as missing:
            raise MissingDependency(
                'a client of the bridge needs websockets; pip install "tensionlab[haptics]" brings it'
            ) from missing
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._stack = ExitStack()
        try:
            line = connect(f"{url}/command", additional_headers=headers, compression=None)
            self._line = self._stack.enter_context(line)
        except (OSError, WebSocketException) as error:
            raise HardwareError(f"{url}: the bridge cannot be reached: {error}") from None
        self.events: list[dict[str, Any]] = []
        with self._stack:  # left at once if the bridge refuses
            self.welcome = Welcome.model_validate(self._answer("welcome"))
            self._stack = self._stack.pop_all()

    def __enter__(self) -> Self:
        """Stay connected in a with block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Go; the force goes with it."""
        self.close()

    def close(self) -> None:
        """Go."""
        self._stack.close()

    def send(self, message: Message) -> State:
        """Send a `Frame` or a `Stop`; how is the rig?"""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):  # what the bridge said last tells why
            self._line.send(message.model_dump_json())
        return State.model_validate(self._answer("state"))

    def frame(
        self,
        time: float,
        hand: tuple[float, ...] | None = None,
        effects: dict[str, dict[str, Any]] | None = None,
        sequence: int = 0,
    ) -> State:
        """Send where the hand is (m) at a time (s), and what it is to feel; how is the rig?"""
        bodies = {} if hand is None else {"hand": {"position": hand}}
        return self.send(
            Frame.model_validate({"time": time, "bodies": bodies, "effects": effects, "sequence": sequence})
        )

    def _answer(self, kind: str) -> dict[str, Any]:
        from websockets.exceptions import WebSocketException

        while True:
            try:
                found: dict[str, Any] = json.loads(self._line.recv())
            except WebSocketException as error:
                ended = [event["text"] for event in self.events if event["kind"] == "ended"]
                raise HardwareError(f"the bridge has gone: {ended[-1] if ended else error}") from None
            if found["type"] == "refused":
                raise HardwareError(f"the bridge refused: {found['reason']}")
            if found["type"] == kind:
                return found
            self.events.append(found)
