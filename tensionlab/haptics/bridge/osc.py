"""The same over OSC (Open Sound Control 1.0, UDP), for what speaks that: nothing is answered.

::

    /body/hand x y z [qx qy qz qw]        where a body is, in m
    /effect/NAME KIND [parameter value]*  what the hand is to feel; a vector takes so many numbers
    /effect/NAME                          no more of it
    /stop                                 end the run

What comes in one bundle is so at the same time: that of its tag, if it has one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from pydantic import ValidationError

from tensionlab.errors import EffectError, HardwareError, MissingDependency
from tensionlab.haptics.bridge.mailbox import Mailbox
from tensionlab.haptics.bridge.messages import Frame

if TYPE_CHECKING:
    from pythonosc.dispatcher import Dispatcher


class OscDoor:
    """Puts what comes over UDP into a mailbox, by a thread of its own. A context manager.

    Parameters
    ----------
    mailbox : Mailbox
    host, port : str, int
        Where to listen; port 0 takes a free one.
    refused : callable
        Hears why a message came to nothing.

    Attributes
    ----------
    port : int

    Raises
    ------
    HardwareError
        If it cannot listen there.
    MissingDependency
        If python-osc is not installed.
    """

    def __init__(self, mailbox: Mailbox, host: str, port: int, refused: Callable[[str], None]) -> None:
        try:
            from pythonosc.osc_server import BlockingOSCUDPServer
        except ImportError as missing:
            raise MissingDependency(
                'OSC needs python-osc; pip install "tensionlab[haptics]" brings it'
            ) from missing
        self._mailbox, self._refused = mailbox, refused
        self._bodies: dict[str, dict[str, Any]] = {}
        self._effects: dict[str, dict[str, Any]] = {}
        try:
            self._server = BlockingOSCUDPServer((host, port), _dispatcher(self._take))
        except OSError as error:
            raise HardwareError(f"OSC cannot listen at {host}, port {port}: {error.strerror}") from None
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, name="OSC", daemon=True)

    def __enter__(self) -> Self:
        """Listen."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _take(self, messages: list[tuple[str, list[Any]]], when: float | None) -> None:
        """Take the messages of one bundle, or one by itself, as one frame."""
        now = time.monotonic()
        try:
            for address, values in messages:
                self._note(address, values)
            frame = {
                "type": "frame",
                "time": now if when is None else when,
                "bodies": self._bodies,
                "effects": self._effects,
            }
            self._mailbox.put(Frame.model_validate(frame), now)
        except (ValidationError, EffectError) as error:
            self._bodies, self._effects = {}, {}
            self._refused(f"{', '.join(address for address, _ in messages)}: {error}")

    def _note(self, address: str, values: list[Any]) -> None:
        match address.split("/")[1:]:
            case ["body", name]:
                self._bodies[name] = {"position": values[:3], "rotation": values[3:] or None}
            case ["effect", name] if values:
                self._effects[name] = {"kind": values[0], **_parameters(values[1:])}
            case ["effect", name]:
                self._effects.pop(name, None)
            case ["stop"]:
                self._mailbox.stop_wanted = True
            case _:
                raise EffectError(f"no address {address}; there are /body/NAME, /effect/NAME and /stop")


def _dispatcher(take: Callable[[list[tuple[str, list[Any]]], float | None], None]) -> Dispatcher:
    """To whom is each datagram handed? A `Dispatcher` as it is does not tell where a bundle ends."""
    from pythonosc.dispatcher import Dispatcher
    from pythonosc.osc_bundle import OscBundle
    from pythonosc.osc_packet import OscPacket, ParseError
    from pythonosc.parsing.osc_types import IMMEDIATELY

    class Bundles(Dispatcher):
        def call_handlers_for_packet(self, data: bytes, client_address: tuple[str, int]) -> list[object]:
            """Take what is in a datagram; nothing is answered."""
            with suppress(ParseError):
                messages = [(each.message.address, each.message.params) for each in OscPacket(data).messages]
                when = OscBundle(data).timestamp if OscBundle.dgram_is_bundle(data) else IMMEDIATELY
                take(messages, None if when == IMMEDIATELY else when)
            return []

    return Bundles()


def _parameters(values: list[Any]) -> dict[str, Any]:
    """Words, each followed by its number or numbers."""
    found: dict[str, list[float]] = {}
    name = ""
    for value in values:
        if isinstance(value, str):
            name = value
            found[name] = []
        elif name:
            found[name].append(value)
        else:
            raise EffectError(f"a number, {value}, without a parameter before it")
    return {name: numbers[0] if len(numbers) == 1 else tuple(numbers) for name, numbers in found.items()}
