"""A module that speaks protocol 1, for the tests: today's, behind frames of then. Its codec is its own."""

from __future__ import annotations

from binascii import crc_hqx

from tensionlab.hardware.protocol.codes import Type
from tensionlab.hardware.protocol.frames import Decoder, Frame
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import SimulatedModule


def pack(frame: Frame) -> bytes:
    """COBS( type, sequence number, payload, CRC-16 ) and a zero."""
    body = bytes([frame.type, frame.sequence]) + frame.payload
    body += crc_hqx(body, 0xFFFF).to_bytes(2, "little")
    return b"".join(bytes([len(run) + 1]) + run for run in body.split(b"\0")) + b"\0"


def unpack(stuffed: bytes) -> Frame | None:
    runs = []
    while stuffed:
        code, run, stuffed = stuffed[0], stuffed[1 : stuffed[0]], stuffed[stuffed[0] :]
        if code != len(run) + 1:
            return None
        runs.append(run)
    body = b"\0".join(runs)
    if len(body) < 4 or crc_hqx(body[:-2], 0xFFFF) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0], body[1], body[2:-2])


class LinkTo1(SimulatedLink):
    """A link to such a module. `heard` are the types of the commands that it understood."""

    def __init__(self, module: SimulatedModule, url: str = "sim:") -> None:
        super().__init__(module, url)
        self.heard: list[Type] = []
        self._rest, self._decoder = b"", Decoder()

    def send(self, content: bytes) -> None:
        *pieces, self._rest = (self._rest + content).split(b"\0")
        for frame in filter(None, map(unpack, pieces)):
            self.heard.append(Type(frame.type))
            super().send(frame.pack())

    def receive(self, timeout: float) -> bytes:
        said = self._decoder.feed(super().receive(timeout))
        return b"".join(pack(self._as_1(frame)) for frame in said)

    @staticmethod
    def _as_1(frame: Frame) -> Frame:
        return Frame(frame.type, frame.sequence, b"\1" + frame.payload[1:]) if frame.type == Type.INFO else frame
