"""Ports that may have a module, the pulse that identifies it, and the round trips of its link."""

import os
import socket

import numpy as np
import pytest

from tensionlab.errors import ModuleFault
from tensionlab.hardware.client import diagnostics
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule
from tests.helpers.modules import serial_port


def test_ports_that_look_like_a_module_s_are_listed_or_all(monkeypatch):
    ours = (
        serial_port("/dev/ttyUSB0", "CP2102N USB to UART Bridge Controller", "USB VID:PID=10C4:EA60", 0x10C4),
        serial_port("/dev/cu.wchusbserial1410", "USB Serial", "USB VID:PID=1A86:7523", 0x1A86),
        serial_port("/dev/rfcomm0"),
        serial_port("/dev/cu.tensionlab-0000001a"),
        serial_port("COM5", "Standard Serial over Bluetooth link (COM5)", "BTHENUM\\{00001101-0000"),
    )
    others = (
        serial_port("/dev/ttyS0"),
        serial_port("/dev/ttyACM0", "Arduino Uno", "USB VID:PID=2341:0043", 0x2341),
        serial_port("/dev/cu.Bluetooth-Incoming-Port"),
    )
    monkeypatch.setattr(diagnostics, "serial_ports", lambda: [*ours, *others])
    monkeypatch.setattr(diagnostics, "paired", dict)
    assert list(diagnostics.ports()) == [port.device for port in ours]
    assert diagnostics.ports(everything=True)["/dev/ttyACM0"] == "Arduino Uno"
    assert diagnostics.ports()["/dev/rfcomm0"] == ""


def test_ports_without_a_module_say_why(locks_folder, monkeypatch):
    monkeypatch.setattr(diagnostics, "TIMEOUTS_S", (0.05,))
    silent, taken, closed = (socket.create_server(("127.0.0.1", 0)) for _ in range(3))
    urls = ["socket://{}:{}".format(*server.getsockname()) for server in (silent, taken, closed)]
    closed.close()
    lock = LinkLock(urls[1])
    found = diagnostics.find_all(dict.fromkeys(urls, ""))
    lock.release()
    silent.close()
    taken.close()
    assert found[0].problem == "no answer"
    assert f"in use by process {os.getpid()}" in found[1].problem
    assert "refused" in found[2].problem
    assert [port.in_use for port in found] == [False, True, False]


def faulty(conditions, seed=1):
    module = SimulatedModule()
    module.advance(STEP_S)
    return ModuleClient("one", FaultyLink(SimulatedLink(module), conditions, seed=seed))


def test_three_pulses_of_half_a_newton_and_then_nothing(client):
    pulled, advance = [], client.link.module.advance

    def watched(seconds):
        advance(seconds)
        pulled.append(client.link.module.sample.commanded)

    client.link.module.advance = watched
    begun = []
    diagnostics.identify(client, lambda: begun.append(client.state))
    assert begun == [State.ARMED]
    pulled = np.array(pulled)
    assert pulled.max() == pytest.approx(0.5 + diagnostics.PULSE_TENSION_N)
    strong = pulled > 0.75
    assert np.count_nonzero(np.diff(strong.astype(int)) == 1) == diagnostics.PULSES
    assert client.state is State.IDLE
    assert pulled.size * STEP_S < 3.0


def test_it_is_stopped_if_it_is_interrupted(client):
    def interrupt():
        raise KeyboardInterrupt

    client.check = interrupt
    with pytest.raises(KeyboardInterrupt):
        diagnostics.identify(client, print)
    assert client.state is State.IDLE


def test_one_that_let_go_must_be_cleared_or_mended_but_a_timeout_is_no_obstacle(client):
    client.estop()
    with pytest.raises(ModuleFault, match='"one" is in ESTOP: find out why, then `tensionlab module clear sim:`'):
        diagnostics.identify(client, print)
    client.clear()
    client.arm()
    client.listen(0.4)
    assert client.link.module.sample.state is State.TIMEOUT
    diagnostics.identify(client, print)
    assert client.state is State.IDLE
    client.link.module.damage("encoder")
    client.listen(0.1)
    with pytest.raises(ModuleFault, match="refused Arm: FAULT_PRESENT"):
        diagnostics.identify(client, print)


def test_trips_are_as_long_as_the_link_makes_them():
    with faulty(Conditions(latency=0.03, jitter=0.02)) as one:
        times = diagnostics.measure(one, 200, lambda done: True)
    assert 0.060 <= times.min() < 0.066
    middle, *high = (diagnostics.percentile(times, share) for share in (50, 95, 99, 100))
    assert middle == pytest.approx(0.08, abs=0.003)
    assert middle < high[0] < high[1] <= high[2] < 0.102


def test_what_does_not_come_back_is_lost_and_no_late_answer_is_taken_for_another():
    with faulty(Conditions(latency=0.01, drop=0.01), seed=4) as one:
        times = diagnostics.measure(one, 100, lambda done: True)
    assert len(times) == 100
    assert 10 < np.isnan(times).sum() < 50
    assert np.nanmax(times) < 0.03


@pytest.mark.parametrize(
    ("trip", "lost", "ttl", "bluetooth", "expected"),
    [
        (0.1, 0, 0.25, True, (3 / 0.2, 100.0)),
        (0.1, 0, 0.25, False, (3 / 0.2, 1000.0)),
        (0.1, 25, 0.25, True, (10 / 0.2, 100.0)),  # of four, one is lost: 0.25**10 < 1e-6 < 0.25**9
        (0.1, 225, 0.25, True, None),  # 49 in 200 ms
        (0.45, 0, 0.25, True, None),  # 3 in 25 ms
        (0.45, 0, 0.25, False, (120.0, 1000.0)),
        (0.6, 0, 0.25, False, None),
    ],
)
def test_the_rule_of_the_safe_rate(trip, lost, ttl, bluetooth, expected):
    times = np.array([trip] * 75 + [np.nan] * lost)
    found = diagnostics.safe_rates(times, ttl, bluetooth=bluetooth)
    assert found == (None if expected is None else pytest.approx(expected))
    assert diagnostics.safe_rates(np.full(5, np.nan), ttl, bluetooth=bluetooth) is None


def test_what_is_bluetooth(monkeypatch):
    hardware = {"COM3": "USB VID:PID=10C4:EA60 SER=1", "COM5": r"BTHENUM\{00001101-0000-1000-8000-00805F9B34FB}"}
    ports = [serial_port(url, hwid=text) for url, text in hardware.items()]
    monkeypatch.setattr(diagnostics, "serial_ports", lambda: ports)
    links = ["bt://AA:BB:CC:DD:EE:FF/1", "/dev/rfcomm0", "/dev/cu.tensionlab-1a2b3c4d", "com5", "COM5"]
    assert all(map(diagnostics.is_bluetooth, links))
    assert not any(map(diagnostics.is_bluetooth, ["COM3", "COM4", "/dev/ttyUSB0", "socket://127.0.0.1:1", "sim:"]))
