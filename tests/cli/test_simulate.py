"""Modules in a process of their own, over real TCP and real pseudo-terminals."""

import signal
import socket
import statistics
import sys
import time
from pathlib import Path

import pytest
import serial

from benchmarks.processes import simulated
from tensionlab.cli import main
from tensionlab.hardware.client.group import load_modules
from tensionlab.hardware.protocol.codes import Calibration, Code, Fault, State
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    ConfigureTelemetry,
    EmergencyStop,
    Event,
    GetParameter,
    Hello,
    Info,
    ParameterValue,
    Ping,
    Pong,
    Save,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
)
from tensionlab.hardware.protocol.parameters import PARAMETERS
from tensionlab.model.files import load_rig
from tests.support.wire import Client, connected

pytestmark = pytest.mark.realtime  # modules in another process, over TCP and pseudo-terminals

ROOT = Path(__file__).parents[2]
RIG = ROOT / "datasets" / "rigs" / "bartels2026-validation.toml"
LINKS = [[]] if sys.platform == "win32" else [[], ["--pty"]]


@pytest.fixture(scope="module")
def alone():
    """One module that stays for all tests that ask for it."""
    with simulated() as (links, _):
        yield links["module"]


def run(client, tension=1.0, ttl_ms=2000):
    """Have an uncalibrated module pull."""
    client.ask(Stop())
    assert client.ask(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)).code is Code.OK
    assert client.ask(Arm(7)).code is Code.OK
    client.send(SetTension(7, tension, ttl_ms=ttl_ms))


def test_every_module_of_a_rig_answers_at_its_link(tmp_path):
    file = tmp_path / "modules.toml"
    with simulated(RIG, "--modules", file) as (links, _):
        assert load_modules(file) == links
        rig = load_rig(RIG)
        assert list(links) == [module.name for module in rig.modules]
        numbers = []
        for link in links.values():
            assert not link.endswith(":0")
            with connected(link) as client:
                info = client.ask(Hello(), Info)
                assert info.calibrated
                numbers.append(info.serial_number)
        assert numbers == [1, 2, 3, 4]


@pytest.mark.parametrize("how", LINKS)
def test_a_ping_comes_back_at_once(how):
    with simulated(*how) as (links, _), connected(links["module"]) as client:
        assert statistics.median(client.ping() for _ in range(50)) < 5e-3


def test_latency_and_jitter_are_as_asked():
    with (
        simulated("--latency-ms", 20, "--jitter-ms", 15, "--seed", 5) as (links, _),
        connected(links["module"]) as client,
    ):
        times = [client.ping() for _ in range(40)]
    assert min(times) >= 0.040
    assert 0.050 <= statistics.median(times) <= 0.065
    assert max(times) > 0.055


@pytest.mark.parametrize("option", ["--drop-pct", "--corrupt-pct"])
def test_what_is_lost_or_damaged_makes_bad_frames_and_no_wrong_ones(option):
    with simulated(option, 1, "--seed", 2) as (links, _), connected(links["module"]) as client:
        sent = [1_000_000_007 * number for number in range(1, 201)]
        for number in sent:
            client.send(Ping(number))
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            client.take()
        echoes = [message.echo for message in client.messages if isinstance(message, Pong)]
        assert set(echoes) <= set(sent)
        assert 100 < len(echoes) < 190
        assert client.decoder.bad_frames > 5
        while True:  # until the command, its acknowledgement and a telemetry came through whole
            client.send(ConfigureTelemetry(20))
            try:
                telemetry = client.wait(Telemetry, seconds=0.2)
                break
            except TimeoutError:
                continue
        assert telemetry.bad_frames > 5
        # Where the zero between two frames was hit, both are lost and one is counted.
        assert telemetry.bad_frames + client.decoder.bad_frames >= (200 - len(echoes)) / 2


def test_a_part_breaks_when_it_was_planned():
    with simulated("--fault", "encoder@1500ms") as (links, _), connected(links["module"]) as client:
        run(client)
        client.ask(ConfigureTelemetry(5))
        assert client.wait(Telemetry).state is State.RUNNING
        last = first = None
        for _ in range(600):
            telemetry = client.wait(Telemetry)
            if telemetry.state is State.FAULT:
                first = telemetry
                break
            last = telemetry
            client.send(SetTension(7, 1.0, ttl_ms=2000))
        assert first is not None
        assert first.faults == Fault.ENCODER
        assert last.time_us < 1.5e6 + 2e3
        assert first.time_us == pytest.approx(1.5e6, abs=30e3)


def test_a_fault_of_one_module_leaves_the_others_alone():
    with simulated(RIG, "--fault", "top:supply@0s") as (links, _):
        time.sleep(0.1)
        with connected(links["top"]) as client:
            assert client.ask(Arm(1)).code is Code.FAULT_PRESENT
        with connected(links["floor-1"]) as client:
            assert client.ask(Arm(1)).code is Code.OK


def test_settings_survive_a_restart(tmp_path):
    file, index = tmp_path / "settings.bin", PARAMETERS["slew"].index
    with simulated("--config-file", file) as (links, _), connected(links["module"]) as client:
        assert client.ask(SetParameter(index, 33.0)).code is Code.OK
        assert not file.exists()
        assert client.ask(Save()).code is Code.OK
        deadline = time.monotonic() + 5.0
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert client.ask(SetParameter(index, 44.0)).code is Code.OK  # not saved
    with simulated("--config-file", file) as (links, _), connected(links["module"]) as client:
        assert client.ask(GetParameter(index), ParameterValue).value == 33.0
    file.write_bytes(b"spoilt" + file.read_bytes())
    with simulated("--config-file", file) as (links, process), connected(links["module"]) as client:
        assert client.ask(GetParameter(index), ParameterValue).value == PARAMETERS["slew"].standard
        assert "settings.bin: not the settings of a module" in process.stderr.readline()


@pytest.mark.parametrize("how", LINKS)
def test_a_client_that_goes_away_is_a_link_that_closed(how):
    with simulated(*how) as (links, _):
        link = links["module"]
        with connected(link) as client:
            run(client, ttl_ms=2000)
            assert client.ask(Hello(), Info).state is State.RUNNING
        time.sleep(0.2)  # far less than the time to live
        with connected(link) as client:
            assert client.ask(Hello(), Info).state is State.TIMEOUT
            assert client.ask(Stop()).state is State.IDLE


def test_bytes_under_way_when_the_client_goes_arrive_before_the_end():
    with simulated("--latency-ms", 100) as (links, _):
        with connected(links["module"]) as client:
            client.ask(Hello(), Info)
            client.send(EmergencyStop())
        with connected(links["module"]) as client:
            assert client.ask(Hello(), Info).state is State.ESTOP


def test_a_second_client_is_refused_and_the_first_does_not_notice(alone):
    host, _, port = alone.removeprefix("socket://").partition(":")
    with connected(alone) as first:
        assert first.ping() < 1.0
        with socket.create_connection((host, int(port)), timeout=2.0) as second:
            assert second.recv(1) == b""
        assert first.ping() < 1.0
    with connected(alone) as third:
        assert third.ping() < 1.0


def test_time_passes_as_fast_as_here(alone):
    with connected(alone) as client:
        client.send(Ping(1))
        first, start = client.wait(Pong, echo=1).time_us, time.monotonic()
        time.sleep(1.0)
        client.send(Ping(2))
        passed, here = client.wait(Pong, echo=2).time_us - first, time.monotonic() - start
        assert 1e-6 * passed == pytest.approx(here, abs=0.1)


def test_time_can_pass_faster():
    with simulated("--speed", 20, "--latency-ms", 100) as (links, _), connected(links["module"]) as client:
        client.send(Ping(1))
        first = client.wait(Pong, echo=1).time_us
        time.sleep(0.5)
        client.send(Ping(2))
        assert 4e6 < client.wait(Pong, echo=2).time_us - first < 12e6
        assert min(client.ping() for _ in range(10)) >= 0.2 / 20


@pytest.mark.skipif(sys.platform == "win32", reason="nothing stops a process there")
def test_a_machine_that_is_held_up_does_not_make_it_time_out():
    with simulated() as (links, process), connected(links["module"]) as client:
        run(client, ttl_ms=300)
        process.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        client.send(SetTension(7, 1.0, ttl_ms=300))
        process.send_signal(signal.SIGCONT)
        assert client.ask(Hello(), Info).state is State.RUNNING
        assert client.wait(Event, seconds=2.0).state is State.TIMEOUT  # it still does if nobody says more


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_at_once_and_well_and_its_clients_see_it(how):
    with simulated(RIG) as (links, process):
        client = Client(links["top"])
        client.ping()
        process.send_signal(how)
        assert process.wait(2.0) == 0
        with pytest.raises(serial.SerialException):
            client.wait(Event, seconds=2.0)
        client.close()
        with pytest.raises(serial.SerialException):
            Client(links["top"])


def test_the_ports_that_were_asked_for_are_taken_in_turn():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with simulated("--port", free) as (links, _):
        assert links == {"module": f"socket://127.0.0.1:{free}"}
        with pytest.raises(SystemExit) as left:
            main(["simulate", "--port", str(free)])
        assert left.value.code == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fault", "wheel@2s"], "no fault 'wheel@2s'; write one of encoder, supply, motor, brake, cable"),
        (["--fault", "encoder@soon"], "no fault 'encoder@soon'"),
        (["--fault", "left:encoder@2s"], "no module 'left'; there are module"),
        (["--drop-pct", "101"], "drop is a share"),
        (["--latency-ms", "-1"], "latency is from 0 to 60 s"),
        (["--speed", "0"], "--speed is above 0 and at most 1000"),
        (["--port", "70000"], "less than or equal to 65535"),
        (["--listen", "192.0.2.1"], "cannot listen at 192.0.2.1"),
        (["none.toml"], "none.toml: no such file"),
        (["--modules", "none/modules.toml"], "no folder"),
        ([str(ROOT / "datasets" / "rigs" / "cogiro.toml")], "tension_upper is from 0.5 to 12 N; got 5000"),
    ],
)
def test_bad_input_is_status_2_and_says_what_to_do(words, message, capsys):
    with pytest.raises(SystemExit) as left:
        main(["simulate", *words])
    assert left.value.code == 2
    out, err = capsys.readouterr()
    assert message in " ".join(err.replace("│", " ").split())
    assert out == ""
