"""What is left of protocol 1: enough to recognise its modules, and to stop them.

Its messages are those of protocol 2; its frames are not, so neither understands the other by accident.
"""

from __future__ import annotations

from tensionlab.hardware.protocol.codes import State, Type
from tensionlab.hardware.protocol.frames import MAX_PIECE, Frame, pack_1, unpack_1
from tensionlab.hardware.protocol.messages import OtherProtocolError

INFO_SIZE, INFO_STATE = 30, 8
"""Bytes of INFO's payload, and where among them the state is."""


def repetition(command: Frame) -> bytes:
    """Return what asks a module of protocol 1 for INFO, where nobody answered a command; an ESTOP goes before."""
    types = (Type.ESTOP, Type.HELLO) if command.type == Type.ESTOP else (Type.HELLO,)
    return b"".join(pack_1(Frame(each, command.sequence)) for each in types)


class Listener:
    """Find the INFO of a module of protocol 1 in what comes from it."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, content: bytes) -> dict[int, OtherProtocolError]:
        """Return what such an INFO comes to, by the sequence number of what asked for it; mostly nothing."""
        *pieces, rest = (self._rest + content).split(b"\0")
        self._rest = rest[: MAX_PIECE + 1]  # one beyond: too long, whatever follows
        found = {}
        for frame in map(unpack_1, pieces):
            if frame is None or frame.type != Type.INFO or len(frame.payload) != INFO_SIZE:
                continue
            if frame.payload[0] == 1 and frame.payload[INFO_STATE] in tuple(State):
                found[frame.sequence] = OtherProtocolError(1, State(frame.payload[INFO_STATE]))
        return found
