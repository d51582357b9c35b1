"""A device that says anything at all: the host refuses it in words, keeps little of it, and goes on."""

import random
import struct
from types import SimpleNamespace

import pytest

from tensionlab.errors import HardwareError, LinkTimeout, ProtocolError
from tensionlab.hardware.client import diagnostics as discover
from tensionlab.hardware.client import group
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Type
from tensionlab.hardware.protocol.messages import DELIMITER, PROTOCOL, Decoder, Hello, Info, Log, WireFrame, read
from tests.helpers.modules import serial_port

INFO = struct.pack("<BHI3BH3BH5f", PROTOCOL, 1, 1, 0, 0, 0, 0, 1, 1, 28, 250, 0.5, 6.0, 3.0, 0.02, 3.0)


class Liar:
    """A link whose far end answers each command as told; its time passes while somebody waits."""

    lockstep, url = True, "liar:"

    def __init__(self, answer):
        self.answer, self.time = answer, 0.0
        self.said, self.decoder = b"", Decoder()

    def send(self, content):
        for frame in self.decoder.feed(content):
            self.said += self.answer(frame)

    def receive(self, timeout):
        self.time += timeout
        said, self.said = self.said, b""
        return said

    def clock(self):
        return self.time

    def close(self):
        pass


def client(answer):
    return ModuleClient("liar", Liar(answer))


@pytest.mark.parametrize(
    ("kind", "payload", "message"),
    [
        (Type.INFO, INFO[:-1], "Info has 37 bytes of payload; got 36"),
        (
            Type.INFO,
            INFO[:17] + struct.pack("<5f", float("nan"), 6.0, 3.0, 0.02, 3.0),
            "Info: tension_lower is nan",
        ),
        (Type.INFO, INFO[:17] + struct.pack("<5f", 7, 6, 3, 0.02, 3), "tension_lower 7 is above tension_upper 6"),
        (Type.INFO, INFO[:8] + b"\x63" + INFO[9:], "Info: 99 is not a valid State"),
    ],
)
def test_an_answer_that_makes_no_sense_is_told_at_once(kind, payload, message):
    liar = client(lambda frame: WireFrame(kind, frame.sequence, payload).pack())
    with pytest.raises(ProtocolError, match=f'module "liar" sent an invalid answer: .*{message}') as raised:
        liar.hello()
    assert liar.link.time <= 0.2, "after the first try"
    assert len(str(raised.value)) <= 300


@pytest.mark.parametrize("kind", [Type.PONG, Type.PARAMETER, Type.ACKNOWLEDGE])
def test_an_answer_to_something_else_is_none(kind, monkeypatch):
    monkeypatch.setattr(group, "PATIENT_TIMEOUTS_S", (0.05,))
    payload = {Type.PONG: bytes(12), Type.PARAMETER: bytes(13), Type.ACKNOWLEDGE: bytes([Type.HELLO, 0, 0])}[kind]
    liar = client(lambda frame: WireFrame(kind, frame.sequence, payload).pack())
    with pytest.raises(LinkTimeout, match="did not answer Hello"):
        liar.hello()
    with pytest.raises(HardwareError, match='"liar"'):  # and no traceback, where many are asked together
        group.ModuleGroup([liar])._all(Hello(), Info)


@pytest.mark.parametrize("noise", [b"\xff", b"\0", b"\1\0", b"x\0\0", DELIMITER + b"ab"])
def test_endless_bytes_are_not_kept(noise):
    liar = client(lambda frame: noise * 20_000)
    with pytest.raises(LinkTimeout):
        liar.hello()
    kept = liar.endpoint.kept
    assert kept < 500


def test_whatever_a_frame_holds_no_other_error_comes_of_it():
    rng = random.Random(4)
    liar = client(lambda frame: b"")
    for _ in range(5_000):
        kind = rng.choice([*Type, rng.randrange(256)])
        size = rng.choice((0, 3, 4, 12, 13, 34, 41, rng.randrange(57)))
        payload = bytes(rng.choice((0, 1, 2, PROTOCOL, 0xFF, rng.randrange(256))) for _ in range(size))
        liar._feed(WireFrame(kind, rng.randrange(256), payload).pack())
    assert len(liar._answers) <= 256


def test_no_control_characters_of_a_device_reach_a_terminal(monkeypatch):
    assert read(WireFrame(Type.LOG, 0, b"\x1b[2Jmotor\r\n\x07")) == Log("\ufffd[2Jmotor\ufffd\ufffd\ufffd")
    named = serial_port("/dev/ttyUSB0", "CP2102\x1b]0;owned\x07", "USB VID:PID=10C4:EA60", 0x10C4)
    monkeypatch.setattr(discover, "serial_ports", lambda: [named])
    told = SimpleNamespace(stdout="Device AA:BB:CC:DD:EE:0F tensionlab-\033[31m\n")
    monkeypatch.setattr(discover.subprocess, "run", lambda *words, **more: told)
    assert discover.ports() == {
        "/dev/ttyUSB0": "CP2102\ufffd]0;owned\ufffd",
        "bt://AA:BB:CC:DD:EE:0F/1": "tensionlab-\ufffd[31m",
    }
