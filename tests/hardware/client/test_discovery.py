"""Ports that look like a module's, who answers there, and the pulse that tells which it is."""

import sys

import numpy as np
import pytest

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client import discovery
from tensionlab.hardware.client.discovery import PULSE_TENSION_N, PULSES, identify
from tensionlab.hardware.client.links import SerialPort, serial_ports
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


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
    assert discovery.looks_like_ours(port) == ours


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
    assert discovery.paired() == {"bt://AA:BB:CC:DD:EE:0F/1": "tensionlab-0000001a"}
    program.write_text("#!/bin/sh\nexit 1\n")
    assert discovery.paired() == {}
    monkeypatch.setenv("PATH", "")
    assert discovery.paired() == {}


def test_a_port_that_nobody_uses_is_asked_for_its_module():
    found = discovery.find("sim:")
    assert found.info is not None
    assert not found.in_use


@pytest.fixture
def client():
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    with ModuleClient("one", SimulatedLink(simulated)) as found:
        yield found


@pytest.fixture
def calibrated(client):
    client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
    return client


def test_three_pulses_of_half_a_newton_and_then_nothing(calibrated):
    pulled, advance = [], calibrated.link.module.advance

    def watched(seconds):
        advance(seconds)
        pulled.append(calibrated.link.module.sample.commanded)

    calibrated.link.module.advance = watched
    begun = []
    identify(calibrated, lambda: begun.append(calibrated.state))
    assert begun == [State.ARMED]
    pulled = np.array(pulled)
    assert pulled.max() == pytest.approx(0.5 + PULSE_TENSION_N)
    strong = pulled > 0.75
    assert np.count_nonzero(np.diff(strong.astype(int)) == 1) == PULSES
    assert calibrated.state is State.IDLE
    assert pulled.size * STEP_S < 3.0


def test_it_is_stopped_if_it_is_interrupted(calibrated):
    def interrupt():
        raise KeyboardInterrupt

    calibrated.check = interrupt
    with pytest.raises(KeyboardInterrupt):
        identify(calibrated, print)
    assert calibrated.state is State.IDLE


def test_a_module_that_somebody_has_armed_is_left_alone(calibrated):
    calibrated.arm()
    with pytest.raises(HardwareError, match='"one" is ARMED: another program has armed it; stop it there'):
        identify(calibrated, print)
    assert calibrated.link.module.sample.state is State.ARMED


def test_one_that_let_go_must_be_cleared_but_a_timeout_is_no_obstacle(calibrated):
    calibrated.estop()
    with pytest.raises(ModuleFault, match='"one" is in ESTOP: find out why, then `tensionlab module clear sim:`'):
        identify(calibrated, print)
    calibrated.clear()
    calibrated.arm()
    calibrated.listen(0.4)
    assert calibrated.link.module.sample.state is State.TIMEOUT
    identify(calibrated, print)
    assert calibrated.state is State.IDLE


def test_one_that_is_broken_says_where_to_see_it(calibrated):
    calibrated.link.module.damage("encoder")
    calibrated.listen(0.1)
    with pytest.raises(
        ModuleFault, match=r"FAULT_PRESENT .*; something is wrong with it, see `tensionlab module mon"
    ):
        identify(calibrated, print)


def test_one_that_is_not_calibrated_is_told_what_to_do(client):
    with pytest.raises(
        HardwareError, match="not calibrated, and can't be armed: `tensionlab module calibrate gain"
    ):
        identify(client, print)
