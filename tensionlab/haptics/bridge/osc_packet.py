"""Packets of OSC (Open Sound Control 1.0), read within bounds: sizes first, then contents.

A packet is a message or a bundle. A message is an address, type tags and arguments; a bundle is a time tag and
elements, each with its size before it, which are packets again. All is padded to four bytes, and big-endian.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from tensionlab.errors import ProtocolError

MAX_MESSAGES = 64
"""In a packet."""
MAX_DEPTH = 4
"""Of bundles in bundles."""
BUNDLE = b"#bundle\0"
AT_ONCE = 1
"""The time tag that is no time."""
SINCE_1900_S = 2_208_988_800
"""From the beginning of time tags to 1970."""
NUMBERS = {"i": ">i", "f": ">f", "h": ">q", "d": ">d"}
CONSTANTS = {"T": True, "F": False}


class OscMessage(NamedTuple):
    """An address, and what it is given."""

    address: str
    values: list[Any]


class OscPacket(NamedTuple):
    """Messages that belong together, and when they were sent: in s since 1970, or None."""

    messages: list[OscMessage]
    time: float | None


def read_packet(data: bytes) -> OscPacket:
    """Return what is in a datagram.

    Raises
    ------
    ProtocolError
        Saying what is wrong with it.
    """
    messages: list[OscMessage] = []
    time = None
    if data.startswith(BUNDLE):
        if len(data) < 16:
            raise ProtocolError(f"a bundle of {len(data)} bytes; its time tag is missing")
        tag = int.from_bytes(data[8:16], "big")
        time = None if tag == AT_ONCE else tag / 2**32 - SINCE_1900_S
    _read(data, 0, messages)
    return OscPacket(messages, time)


def _read(data: bytes, depth: int, messages: list[OscMessage]) -> None:
    """Read a packet, or an element of a bundle."""
    if len(data) % 4:
        raise ProtocolError(f"{len(data)} bytes; OSC has multiples of 4")
    if not data.startswith(BUNDLE):
        if len(messages) >= MAX_MESSAGES:
            raise ProtocolError(f"more than {MAX_MESSAGES} messages in a packet")
        messages.append(_message(data))
        return
    if depth >= MAX_DEPTH:
        raise ProtocolError(f"bundles in bundles, more than {MAX_DEPTH} deep")
    at = 16
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big", signed=True)
        at += 4
        if not 0 < size <= len(data) - at:
            raise ProtocolError(f"an element of {size} bytes, where {len(data) - at} are left")
        _read(data[at : at + size], depth + 1, messages)
        at += size


def _message(data: bytes) -> OscMessage:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise ProtocolError(f"an address that begins with {address[:1]!r}; addresses begin with /")
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
        elif tag in CONSTANTS:
            values.append(CONSTANTS[tag])
        elif tag in NUMBERS:
            size = struct.calcsize(NUMBERS[tag])
            if at + size > len(data):
                raise ProtocolError(f"arguments of the types {tags[:20]!r}, but they end too early")
            values.append(struct.unpack_from(NUMBERS[tag], data, at)[0])
            at += size
        else:
            raise ProtocolError(f"the type tag {tag!r}; there are {', '.join([*NUMBERS, *CONSTANTS, 's'])}")
    if at != len(data):
        raise ProtocolError(f"{len(data) - at} bytes after the last argument")
    return OscMessage(address, values)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return the text that begins there, and where what follows it begins."""
    end = data.find(b"\0", at)
    if end < 0:
        raise ProtocolError("a text without an end")
    try:
        return data[at:end].decode(), (end // 4 + 1) * 4
    except UnicodeDecodeError:
        raise ProtocolError("a text that is not UTF-8") from None
