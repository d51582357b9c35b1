"""Frames of the module protocol: COBS( type, sequence number, payload ), its CRC-16, and three zeros.

One or two flipped bits of a stream are found, whatever the frames hold; `firmware/PROTOCOL.md` has the argument.
"""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from tensionlab.errors import MissingDependency, ProtocolError

MAX_PAYLOAD = 56
"""Bytes of payload in a frame, at most."""
DELIMITER = b"\0\0\0"
"""End of a frame. It takes three flips to make one of other bytes, none of which is zero."""
FIRST = 0xC0
"""Bits that are set in a frame's first byte, so that it takes three flips to make it a zero."""
CHECKSUM = 3
"""Bytes of a checksum."""
MIN_PIECE, MAX_PIECE = 2 + 1 + CHECKSUM, 2 + MAX_PAYLOAD + 1 + CHECKSUM
"""Bytes between two delimiters: type, sequence number, payload, the code byte of COBS and the checksum."""
MAX_FRAME = MAX_PIECE + len(DELIMITER)
"""Bytes of a frame on the wire, at most."""
TOO_LONG = b"\1" * (MAX_PIECE + 1)
"""Stands for the begin of a piece that is too long already."""


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
    """Return the CRC-16/IBM-3740 of bytes; that of ``b"123456789"`` is 0x29B1."""
    return crc_hqx(content, 0xFFFF)


def checksum(stuffed: bytes) -> bytes:
    """Return the CRC-16 in 7, 7 and 2 bits. All others are set: no byte is zero, nor the last nearly so."""
    crc = crc16(stuffed)
    return bytes([0x80 | crc >> 9, 0x80 | crc >> 2 & 0x7F, 0xFC | crc & 0x03])


def unstuff(stuffed: bytes) -> bytes | None:
    """Return the bytes that COBS made these of; None if it cannot have."""
    cobs = _cobs()
    try:
        return bytes(cobs.decode(stuffed))
    except cobs.DecodeError:
        return None


@dataclass(frozen=True)
class Frame:
    """What is sent in one piece, its meaning aside.

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
        """Return the frame's bytes on the wire."""
        code, *rest = _cobs().encode(bytes([self.type, self.sequence]) + self.payload)
        stuffed = bytes([code | FIRST, *rest])
        return stuffed + checksum(stuffed) + DELIMITER


def unpack(piece: bytes) -> Frame | None:
    """Return the frame that lies between two delimiters; None if it is damaged."""
    if not MIN_PIECE <= len(piece) <= MAX_PIECE or 0 in piece:
        return None
    stuffed, found = piece[:-CHECKSUM], piece[-CHECKSUM:]
    if stuffed[0] & FIRST != FIRST or found != checksum(stuffed):
        return None
    body = unstuff(bytes([stuffed[0] ^ FIRST]) + stuffed[1:])
    return None if body is None or len(body) < 2 else Frame(body[0], body[1], body[2:])


def pack_1(frame: Frame) -> bytes:
    """Return the bytes of a frame in protocol 1, which ended with one zero; here with a delimiter."""
    body = bytes([frame.type, frame.sequence]) + frame.payload
    return bytes(_cobs().encode(body + crc16(body).to_bytes(2, "little"))) + DELIMITER


def unpack_1(piece: bytes) -> Frame | None:
    """Return the frame of protocol 1 that lies between two zeros; None if it is damaged, or none."""
    body = unstuff(piece) if len(piece) <= MAX_PIECE else None
    if body is None or len(body) < 4 or crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0], body[1], body[2:-2])


@dataclass
class Decoder:
    """Pick frames out of a stream of bytes, however it is cut into pieces.

    Attributes
    ----------
    bad_frames : int
        How many were damaged, too long or too short, and left out. Whole frames of protocol 1 are not counted.
    """

    bad_frames: int = 0
    _rest: bytes = field(default=b"", repr=False)

    def feed(self, content: bytes) -> list[Frame]:
        """Return the frames that these bytes complete."""
        frames = []
        # More zeros than three belong to the delimiter before.
        *ended, rest = (piece.lstrip(b"\0") for piece in (self._rest + content).split(DELIMITER))
        for piece in ended:
            frame = unpack(piece)
            if frame is not None:
                frames.append(frame)
            elif piece and unpack_1(piece) is None:
                self.bad_frames += 1
        # Of what is too long already only its last zeros matter, with which a delimiter may begin.
        self._rest = rest if len(rest) <= MAX_PIECE + 2 else TOO_LONG + rest[-2:]
        return frames
