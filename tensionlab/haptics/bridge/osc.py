"""Bridge over OSC (Open Sound Control 1.0, UDP), without answers.

::

    /body/hand x y z [qx qy qz qw]        position of a body, in m, and its rotation
    /effect/NAME KIND [parameter value]*  an effect; a vector has several values, a part a dot: wall.stiffness
    /effect/NAME                          remove it
    /stop                                 end the run

The messages of a bundle are simultaneous, at the time of its tag, if it has one. A datagram is taken as a whole or
not at all; other addresses are ignored. Packets are read within bounds: sizes first, then contents.
"""

from __future__ import annotations

import logging
import re
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Self

from tensionlab.errors import EffectError, ProtocolError, TensionlabError, cannot_listen
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.command import SILENCE_S, Budget, Commander, LimitedReport
from tensionlab.haptics.bridge.messages import Frame, parse_message, refusal_reason
from tensionlab.haptics.effects import EFFECTS
from tensionlab.haptics.effects.parameters import list_names
from tensionlab.support.files.reading import brief

ADDRESS = re.compile(r"/stop|/(body|effect)/[^/]+")
MAX_MESSAGES = 64  # in a packet
BUNDLE = b"#bundle\0"
IMMEDIATELY = 1  # time tag without a time
SINCE_1900_S = 2_208_988_800  # from the epoch of time tags to 1970
NUMBERS = {"i": ">i", "f": ">f", "h": ">q", "d": ">d"}
MAX_PARTS = 3  # dots in the name of a parameter, such as `wall.plane.point`
MAX_DATAGRAM_BYTES = 65_536
POLL_S = 0.25  # longest wait for a datagram before the thread checks whether to end
PAUSE_S = 0.02  # pause of reading after a datagram beyond the budget
MAX_DROPPED = 1000  # datagrams discarded then
RECEIVE_BUFFER_BYTES = 65_536  # unread datagrams, with the system's overhead for each


class OscMessage(NamedTuple):
    """Address and values."""

    address: str
    values: list[Any]


class OscPacket(NamedTuple):
    """Messages that belong together, and when they were sent: in s since 1970, or None."""

    messages: list[OscMessage]
    time: float | None


def read_packet(data: bytes) -> OscPacket:
    """Return the messages of a datagram; `ProtocolError` says what is wrong with it.

    A packet, big-endian and padded to four bytes, is a message (address, type tags, arguments) or a bundle: a time
    tag, and messages after their sizes. Bundles in a bundle are refused.
    """
    if len(data) % 4:
        raise ProtocolError(f"{len(data)} bytes; OSC has multiples of 4")
    if not data.startswith(BUNDLE):
        return OscPacket([_message(data)], None)
    if len(data) < 16:
        raise ProtocolError(f"a bundle of {len(data)} bytes; its time tag is missing")
    tag, at = int.from_bytes(data[8:16], "big"), 16
    messages: list[OscMessage] = []
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big", signed=True)
        at += 4
        if size % 4 or not 0 < size <= len(data) - at:
            raise ProtocolError(f"an element of {size} bytes in {len(data) - at}; OSC has multiples of 4")
        if len(messages) >= MAX_MESSAGES:
            raise ProtocolError(f"more than {MAX_MESSAGES} messages in a packet")
        messages.append(_message(data[at : at + size]))
        at += size
    return OscPacket(messages, None if tag == IMMEDIATELY else tag / 2**32 - SINCE_1900_S)


def _message(data: bytes) -> OscMessage:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise ProtocolError(f"an address that begins with {address[:1]!r}; those of messages begin with /")
    if at == len(data):  # old senders leave the type tags out where there are no arguments
        return OscMessage(address, [])
    tags, at = _text(data, at)
    if not tags.startswith(","):
        raise ProtocolError("no type tags after the address")
    values: list[Any] = []
    for tag in tags[1:]:
        if tag == "s":
            text, at = _text(data, at)
            values.append(text)
        elif tag in NUMBERS:
            size = struct.calcsize(NUMBERS[tag])
            if at + size > len(data):
                raise ProtocolError(f"arguments of the types {tags[:20]!r}, but they end too early")
            values.append(struct.unpack_from(NUMBERS[tag], data, at)[0])
            at += size
        else:
            raise ProtocolError(f"the type tag {tag!r}; there are {', '.join([*NUMBERS, 's'])}")
    if at != len(data):
        raise ProtocolError(f"{len(data) - at} bytes after the last argument")
    return OscMessage(address, values)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return the text at an offset, and the offset after it."""
    end = data.find(b"\0", at)
    if end < 0:
        raise ProtocolError("a text without an end")
    try:
        return data[at:end].decode(), (end // 4 + 1) * 4
    except UnicodeDecodeError:
        raise ProtocolError("a text that is not UTF-8") from None


class OscServer:
    """Server for OSC over UDP, with its own thread. A context manager; `HardwareError` if it cannot listen.

    Each machine is one client, which commands like any other: see `Command`. ``report`` is called with a line for
    each refusal; repeated ones are only counted. Port 0 takes a free one.
    """

    def __init__(self, client: ClientState, host: str, port: int, report: Callable[[str], None]) -> None:
        self._client, self._budget = client, Budget()
        self._report = LimitedReport(report, client.clock)
        self._bodies: dict[str, dict[str, Any]] = {}
        self._effects: dict[str, dict[str, Any]] = {}
        self._commander: Commander | None = None
        self._machine, self._latest = "", 0.0
        self._tag: float | None = None
        self._over = False
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            self._socket.bind(address)
        except OSError as error:
            raise cannot_listen("OSC", host, port, error) from None
        self._socket.settimeout(POLL_S)
        self.port = int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._listen, name="OSC", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()
        self._socket.close()
        self._report.finish()

    def _listen(self) -> None:
        while not self._over:
            try:
                data, address = self._socket.recvfrom(MAX_DATAGRAM_BYTES)
            except OSError:  # no datagram, or an error about one that was sent before
                continue
            if not self.receive(data, str(address[0])):
                self._drop()

    def receive(self, data: bytes, machine: str) -> bool:
        """Take a datagram; return False if it exceeds the budget."""
        now, began = self._client.clock(), time.thread_time()
        if reason := self._budget.refuse(len(data), now):
            self._report(f"OSC from {machine}: {reason}")
            return False
        self._take(data, machine, now)
        self._budget.add_reading(time.thread_time() - began, now)
        return True

    def _drop(self) -> None:
        time.sleep(PAUSE_S)
        self._socket.setblocking(False)
        try:
            for _ in range(MAX_DROPPED):
                self._socket.recvfrom(MAX_DATAGRAM_BYTES)
        except OSError:  # no more
            pass
        finally:
            self._socket.settimeout(POLL_S)

    def _take(self, data: bytes, machine: str, now: float) -> None:
        try:
            commander = self._known(machine, now)
            if commander is None:
                self._client.command.require_free(now)
            packet = read_packet(data)
            known = []
            for message in packet.messages:
                if ADDRESS.fullmatch(message.address):
                    known.append(message)
                    continue
                there = "there are /body/NAME, /effect/NAME and /stop"
                self._report(f"OSC from {machine}: no address {brief(message.address)}; {there}")
            if known:
                commander = commander or self._begin(machine, now)
                self._tag = packet.time or self._tag  # a datagram without a tag is not earlier than others
                self._put(known, self._tag or now, now, commander)
        except TensionlabError as error:
            self._report(f"OSC from {machine}: {refusal_reason(error)}")
        except Exception as error:  # unforeseen: no datagram ends the thread
            logging.getLogger(__name__).exception("a datagram from %s", machine)
            self._report(f"OSC from {machine}: {refusal_reason(error)}")

    def _known(self, machine: str, now: float) -> Commander | None:
        """Return the client of a machine that commands, or did; None if it may start afresh after a silence."""
        mine = self._commander
        if mine is None or machine != self._machine:
            return None
        latest, self._latest = self._latest, now
        return None if mine.dismissed and now - latest >= SILENCE_S else mine

    def _begin(self, machine: str, now: float) -> Commander:
        self._commander = self._client.command.take(f"OSC from {machine}", now, lambda reason: None)
        self._machine, self._latest = machine, now
        self._bodies, self._effects, self._tag = {}, {}, None
        return self._commander

    def _put(self, messages: list[OscMessage], when: float, now: float, commander: Commander) -> None:
        if any(message.address == "/stop" for message in messages):
            self._client.stop(now, commander)
            return
        bodies, effects = dict(self._bodies), dict(self._effects)
        for message in messages:
            _add(message, bodies, effects)
        frame = parse_message({"type": "frame", "time": when, "bodies": bodies, "effects": effects})
        assert isinstance(frame, Frame)
        self._client.put(frame, now, commander)
        self._bodies, self._effects = bodies, effects


def _add(message: OscMessage, bodies: dict[str, Any], effects: dict[str, Any]) -> None:
    _, what, name = message.address.split("/")
    values = message.values
    if what == "body":
        bodies[name] = {"position": values[:3], "rotation": values[3:] or None}
    elif values:
        effects[name] = {**_parameters(name, values), "kind": values[0]}
    else:
        effects.pop(name, None)


def _parameters(effect: str, values: list[Any]) -> dict[str, Any]:
    """Return a kind and names, each with its values, as a table; ``plane.point`` is a name in a part."""
    lists = list_names(EFFECTS.get(str(values[0]), object))
    parameters: dict[str, list[Any]] = {}
    name = ""
    for value in values[1:]:
        if isinstance(value, str) and not (name.endswith(".kind") and not parameters[name]):
            name = value
            parameters[name] = []
        elif name:
            parameters[name].append(value)
        else:
            raise EffectError(f"effect {effect!r}: a number, {value}, without a parameter before it")
    table: dict[str, Any] = {}
    for name, given in parameters.items():
        *parts, key = name.split(".", MAX_PARTS)
        part = table
        for part_name in parts:
            part = part.setdefault(part_name, {})
            if not isinstance(part, dict):
                raise EffectError(f"effect {effect!r}: {name}: {part_name} has a value; give that or its parts")
        part[key] = given[0] if len(given) == 1 and name not in lists else tuple(given)
    return table
