"""Frames of the module protocol: COBS( type, sequence number, payload ), its CRC-16, and three zeros.

One or two flipped bits of a stream are always detected; ``firmware/PROTOCOL.md`` has the argument. The codec
is the firmware's own, compiled in.
"""

from __future__ import annotations

from typing import NamedTuple

from tensionlab import _native
from tensionlab.errors import ProtocolError

# Most bytes of payload in a frame, and between two delimiters.
MAX_PAYLOAD, MAX_PIECE = _native.MAX_PAYLOAD, _native.MAX_PIECE
DELIMITER = b"\0\0\0"  # end of a frame. It takes three flips to make one of other bytes, none of which is zero.
CHECKSUM_BYTES = 3  # bytes of a checksum
MAX_FRAME = MAX_PIECE + len(DELIMITER)  # most bytes of a frame on the wire


class WireFrame(NamedTuple):
    """Frame: type (bit 7: from a module), sequence number (an answer has the command's) and payload."""

    type: int
    sequence: int
    payload: bytes = b""

    def pack(self) -> bytes:
        """Return the frame's bytes on the wire; a `ProtocolError` if a number or the payload is too large."""
        try:
            return _native.build_frame(*self)
        except ValueError as error:
            raise ProtocolError(str(error)) from None


class Decoder:
    """Decoder of a stream of bytes, however it is cut into pieces.

    `bad_frames` counts those that were damaged, too long or too short.
    """

    def __init__(self) -> None:
        self._native = _native.FrameDecoder()

    def feed(self, content: bytes) -> list[WireFrame]:
        """Return the frames that these bytes complete."""
        return [WireFrame(*found) for found in self._native.feed(content)]

    @property
    def bad_frames(self) -> int:
        """Number of bad frames up to now."""
        return self._native.bad_frames

    @property
    def kept(self) -> int:
        """Number of bytes that wait for what completes them."""
        return self._native.kept
