"""Golden frames: both sides agree on them, and no damage makes another command of one."""

import json
import runpy
from pathlib import Path

import pytest

from tensionlab import _native
from tensionlab.hardware.protocol import messages as protocol
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import DELIMITER, Decoder, WireFrame
from tests.helpers.modules import Host, armed

FIRMWARE = Path(__file__).parents[2] / "firmware"
VECTORS = json.loads((FIRMWARE / "vectors.json").read_text())
NAMES = [f"{index}-{vector['message']}" for index, vector in enumerate(VECTORS)]
each_vector = pytest.mark.parametrize("vector", VECTORS, ids=NAMES)


def test_the_file_is_fresh_and_has_every_message():
    written = runpy.run_path(str(FIRMWARE / "vectors.py"))["vectors"]()
    assert written == (FIRMWARE / "vectors.json").read_text(), "run: python firmware/vectors.py"
    assert {vector["type"] for vector in VECTORS} == set(protocol.Type)


@each_vector
def test_both_sides_write_and_read_the_frame(vector):
    wire, payload = bytes.fromhex(vector["frame"]), bytes.fromhex(vector["payload"])
    kind, sequence = vector["type"], vector["sequence"]
    message = getattr(protocol, vector["message"])(**vector["fields"])
    assert message.frame(sequence).pack() == wire
    assert _native.build_frame(kind, sequence, payload) == wire
    assert Decoder().feed(wire) == [WireFrame(kind, sequence, payload)]
    assert _native.parse_frames(wire) == ([(kind, sequence, payload)], 0)
    assert protocol.read(WireFrame(kind, sequence, payload)) == message


@pytest.mark.parametrize("vector", [vector for vector in VECTORS if vector["type"] < 0x80])
def test_the_firmware_knows_each_command_and_its_length(vector):
    frame = WireFrame(vector["type"], 1, bytes.fromhex(vector["payload"]))
    for payload, known in ((frame.payload, True), (frame.payload + b"\0", False), (frame.payload[:-1], False)):
        if not known and payload == frame.payload:
            continue  # there is nothing to leave out
        host = Host()
        host.module.receive(WireFrame(frame.type, 1, payload).pack())
        codes = {answer.code for answer in host.hear() if isinstance(answer, protocol.Acknowledge)}
        assert (protocol.Code.BAD_LENGTH in codes) == (not known)
        assert protocol.Code.UNKNOWN_TYPE not in codes
        host.module.advance(0.01)
        assert known or (host.state, host.module.settings) == (State.IDLE, b"")


def damaged(wire: bytes):
    """Every single bit flipped, every byte dropped, every byte sent twice."""
    for bit in range(8 * len(wire)):
        flipped = bytearray(wire)
        flipped[bit // 8] ^= 1 << bit % 8
        yield bytes(flipped)
    for at in range(len(wire)):
        yield wire[:at] + wire[at + 1 :]
        yield wire[: at + 1] + wire[at:]


@each_vector
def test_no_damage_makes_another_frame_of_it(vector):
    wire = bytes.fromhex(vector["frame"])
    whole = (vector["type"], vector["sequence"], bytes.fromhex(vector["payload"]))
    follower = WireFrame(protocol.Type.PING, 9, bytes(8))
    for stream in damaged(wire):
        found, bad = _native.parse_frames(stream + DELIMITER + follower.pack())
        assert found[-1] == (follower.type, 9, bytes(8)), "and the next frame is read"
        assert found[:-1] in ([whole], []), stream.hex()
        assert bad >= 1 or found[0] == whole


@pytest.mark.parametrize("vector", [vector for vector in VECTORS if vector["type"] < 0x80])
def test_no_damage_moves_a_module(vector):
    """A damaged stop does not stop, and a damaged set-point pulls nothing; the frame after it is read."""
    whole = WireFrame(vector["type"], vector["sequence"], bytes.fromhex(vector["payload"]))
    for stream in damaged(whole.pack()):
        if Decoder().feed(stream + DELIMITER) == [whole]:
            continue  # a zero more at its end is none
        host = armed(session=0x1234)
        host.module.receive(stream + DELIMITER)
        assert host.hear() == []
        assert host.state == State.ARMED
        assert host.module.parameters["slew"] == 60.0
