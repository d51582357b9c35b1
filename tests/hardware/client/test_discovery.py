"""What looks like a module, and what is asked."""

import sys

import pytest

from tensionlab.hardware.client import discovery as discover
from tensionlab.hardware.client.links import SerialPort, serial_ports


@pytest.mark.parametrize(
    ("port", "ours"),
    [
        (
            SerialPort("/dev/ttyUSB0", "CP2102N USB to UART Bridge Controller", "USB VID:PID=10C4:EA60", 0x10C4),
            True,
        ),
        (SerialPort("/dev/cu.wchusbserial1410", "USB Serial", "USB VID:PID=1A86:7523", 0x1A86), True),
        (SerialPort("/dev/rfcomm0", "", "n/a", None), True),
        (SerialPort("/dev/cu.tensionlab-0000001a", "", "n/a", None), True),
        (SerialPort("COM5", "Standard Serial over Bluetooth link (COM5)", "BTHENUM\\{00001101-0000", None), True),
        (SerialPort("/dev/ttyS0", "", "n/a", None), False),
        (SerialPort("/dev/ttyACM0", "Arduino Uno", "USB VID:PID=2341:0043", 0x2341), False),
        (SerialPort("/dev/cu.Bluetooth-Incoming-Port", "", "n/a", None), False),
    ],
)
def test_what_looks_like_a_module(port, ours):
    assert discover.looks_like_ours(port) == ours


def test_this_computers_ports_can_be_listed():
    assert all(port.url for port in serial_ports())


@pytest.mark.skipif(sys.platform == "win32", reason="a script stands in for a program of Linux")
def test_what_linux_knows_by_bluetooth(tmp_path, monkeypatch):
    program = tmp_path / "bluetoothctl"
    program.write_text(
        "#!/bin/sh\n[ \"$*\" = 'devices Paired' ] || exit 1\n"
        "echo 'Device 00:11:22:33:44:55 Headphones'\necho 'Device AA:BB:CC:DD:EE:0F tensionlab-0000001a'\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert discover.paired() == {"bt://AA:BB:CC:DD:EE:0F/1": "tensionlab-0000001a"}
    program.write_text("#!/bin/sh\nexit 1\n")
    assert discover.paired() == {}
    monkeypatch.setenv("PATH", "")
    assert discover.paired() == {}
