"""Frames and bytes: COBS( type, sequence number, payload, CRC-16 ) and a zero byte."""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from tensionlab.errors import MissingDependency, ProtocolError

MAX_PAYLOAD = 56
MAX_FRAME = 2 + MAX_PAYLOAD + 2 + 2
"""Bytes on the wire: type, sequence number, payload, CRC, the code byte of COBS and the zero."""


@cache
def _cobs() -> Any:
    """Import the codec where it is used: codes and logs are read without it."""
    try:
        from cobs import cobs
    except ImportError as missing:
        raise MissingDependency(
            'talking to modules needs the library cobs; pip install "tensionlab[hardware]" brings it'
        ) from missing
    return cobs


def crc16(content: bytes) -> int:
    """Which CRC-16/IBM-3740 do the bytes have? That of ``b"123456789"`` is 0x29B1."""
    return crc_hqx(content, 0xFFFF)


@dataclass(frozen=True)
class Frame:
    """What is sent in one piece, not yet understood.

    Attributes
    ----------
    type : int
        What message it is, 0 to 255; bit 7 is set if it comes from a module.
    sequence : int
        0 to 255. A module's answer has that of the command.
    payload : bytes
        At most `MAX_PAYLOAD` of them.
    """

    type: int
    sequence: int
    payload: bytes = b""

    def __post_init__(self) -> None:
        for name in ("type", "sequence"):
            if not 0 <= getattr(self, name) <= 0xFF:
                raise ProtocolError(f"a frame's {name} is one byte, 0 to 255; got {getattr(self, name)}")
        if len(self.payload) > MAX_PAYLOAD:
            raise ProtocolError(f"a payload has at most {MAX_PAYLOAD} bytes; got {len(self.payload)}")

    def pack(self) -> bytes:
        """What is the frame on the wire?"""
        body = bytes([self.type, self.sequence]) + self.payload
        return bytes(_cobs().encode(body + crc16(body).to_bytes(2, "little"))) + b"\0"


def unpack(stuffed: bytes) -> Frame | None:
    """Which frame do the bytes between two zero bytes hold? None if they are damaged."""
    if not len(stuffed) < MAX_FRAME:
        return None
    cobs = _cobs()
    try:
        body = bytes(cobs.decode(stuffed))
    except cobs.DecodeError:
        return None
    if len(body) < 4 or crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0], body[1], body[2:-2])


@dataclass
class Decoder:
    """Picks frames out of a stream of bytes, however it is cut into pieces.

    Attributes
    ----------
    bad_frames : int
        How many were damaged, too long or too short, and left out.
    """

    bad_frames: int = 0
    _rest: bytearray = field(default_factory=bytearray, repr=False)

    def feed(self, content: bytes) -> list[Frame]:
        """Which frames do these bytes complete?"""
        frames = []
        *ended, begun = content.split(b"\0")
        for piece in ended:
            stuffed = bytes(self._rest) + piece
            self._rest.clear()
            frame = unpack(stuffed)
            if frame is not None:
                frames.append(frame)
            elif stuffed:  # zero bytes may be sent to start afresh
                self.bad_frames += 1
        self._rest += begun
        del self._rest[MAX_FRAME:]  # too long already, whatever follows
        return frames
