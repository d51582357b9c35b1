"""Frames of the module protocol: COBS( type, sequence number, payload ), its CRC-16, and three zeros.

One or two flipped bits of a stream are always detected; ``firmware/PROTOCOL.md`` has the argument.
"""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from tensionlab.errors import ProtocolError, needs

MAX_PAYLOAD = 56
"""Most bytes of payload in a frame."""
DELIMITER = b"\0\0\0"
"""End of a frame. It takes three flips to make one of other bytes, none of which is zero."""
FIRST_BYTE_BITS = 0xC0
"""Bits that are set in a frame's first byte, so that it takes three flips to make it a zero."""
CHECKSUM_BYTES = 3
"""Bytes of a checksum."""
MIN_PIECE, MAX_PIECE = 2 + 1 + CHECKSUM_BYTES, 2 + MAX_PAYLOAD + 1 + CHECKSUM_BYTES
"""Bytes between two delimiters: type, sequence number, payload, the code byte of COBS and the checksum."""
MAX_FRAME = MAX_PIECE + len(DELIMITER)
"""Most bytes of a frame on the wire."""
OVERLONG_START = b"\1" * (MAX_PIECE + 1)
"""Stands for the start of a piece that is already too long."""


@cache
def _cobs() -> Any:
    """Import the codec on first use: codes and logs are read without it."""
    with needs("hardware", "the protocol of modules"):
        from cobs import cobs
    return cobs


def crc16(content: bytes) -> int:
    """Return the CRC-16/IBM-3740 of bytes; that of ``b"123456789"`` is 0x29B1."""
    return crc_hqx(content, 0xFFFF)


def checksum(stuffed: bytes) -> bytes:
    """Return the CRC-16 in 7, 7 and 2 bits, all other bits set, so that no byte is close to zero."""
    crc = crc16(stuffed)
    return bytes([0x80 | crc >> 9, 0x80 | crc >> 2 & 0x7F, 0xFC | crc & 0x03])


def unstuff(stuffed: bytes) -> bytes | None:
    """Return the bytes that COBS encoded; None if these are no COBS code."""
    cobs = _cobs()
    try:
        return bytes(cobs.decode(stuffed))
    except cobs.DecodeError:
        return None


@dataclass(frozen=True)
class Frame:
    """Frame: type (bit 7: from a module), sequence number (an answer has the command's) and payload."""

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
        stuffed = bytes([code | FIRST_BYTE_BITS, *rest])
        return stuffed + checksum(stuffed) + DELIMITER


def unpack(piece: bytes) -> Frame | None:
    """Return the frame between two delimiters; None if it is damaged."""
    if not MIN_PIECE <= len(piece) <= MAX_PIECE or 0 in piece:
        return None
    stuffed, found = piece[:-CHECKSUM_BYTES], piece[-CHECKSUM_BYTES:]
    if stuffed[0] & FIRST_BYTE_BITS != FIRST_BYTE_BITS or found != checksum(stuffed):
        return None
    body = unstuff(bytes([stuffed[0] ^ FIRST_BYTE_BITS]) + stuffed[1:])
    return None if body is None or len(body) < 2 else Frame(body[0], body[1], body[2:])


def pack_1(frame: Frame) -> bytes:
    """Return a frame of protocol 1, which ended with one zero, followed by a delimiter."""
    body = bytes([frame.type, frame.sequence]) + frame.payload
    return bytes(_cobs().encode(body + crc16(body).to_bytes(2, "little"))) + DELIMITER


def unpack_1(piece: bytes) -> Frame | None:
    """Return the frame of protocol 1 between two zeros; None if it is damaged, or none."""
    body = unstuff(piece) if len(piece) <= MAX_PIECE else None
    if body is None or len(body) < 4 or crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0], body[1], body[2:-2])


@dataclass
class Decoder:
    """Decoder of a stream of bytes, however it is cut into pieces.

    `bad_frames` counts those that were damaged, too long or too short; whole frames of protocol 1 are not counted.
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
        self._rest = rest if len(rest) <= MAX_PIECE + 2 else OVERLONG_START + rest[-2:]
        return frames
