"""Simulated modules that other programs reach: in simulated time, and once over each real transport."""

import json
import signal
import socket
import statistics
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.processes import simulated
from tensionlab.cli import main
from tensionlab.errors import LinkError
from tensionlab.hardware.client.links import load_modules
from tensionlab.hardware.protocol.codes import Calibration, Code, State
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    Decoder,
    Event,
    Hello,
    Info,
    Ping,
    SetTension,
    Stop,
    read,
)
from tensionlab.model.files import load_rig
from tests.helpers.served import Simulation
from tests.helpers.wire import connected

ROOT = Path(__file__).parents[2]
RIG = ROOT / "datasets" / "rigs" / "bartels2026-validation.toml"
HANG_S = 600.0  # no event takes that long on a machine that is merely busy


@pytest.fixture
def simulate():
    """Run the verb in this process, in simulated time."""
    made = []

    def start(*words):
        made.append(Simulation(*words))
        return made[-1]

    yield start
    for simulation in made:
        simulation.close()


def pull(client, tension=1.0, ttl_ms=2000):
    """Have an uncalibrated module pull."""
    client.ask(Stop())
    assert client.ask(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)).code is Code.OK
    assert client.ask(Arm(7, client.ask(Hello(), Info).stops)).code is Code.OK
    client.send(SetTension(7, tension, ttl_ms=ttl_ms))


def test_over_tcp_every_module_of_a_rig_answers_at_its_link(run, tmp_path):
    file = tmp_path / "modules.toml"
    with simulated(RIG, "--modules", file) as (links, _):
        assert load_modules(file) == links
        assert list(links) == [module.name for module in load_rig(RIG).modules]
        assert not any(link.endswith(":0") for link in links.values())
        status, out, err = run("module", "info", "--modules", file, "--json")
        assert (status, err) == (0, "")
        found = [each["info"] for each in json.loads(out)]
        assert [info["serial_number"] for info in found] == [1, 2, 3, 4]
        assert all(info["calibrated"] for info in found)


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_it_ends_well_and_its_clients_see_it(how, status):
    with simulated(RIG) as (links, process), connected(links["top"]) as client:
        client.ping()
        process.send_signal(how)
        assert process.wait(HANG_S) == status
        with pytest.raises(LinkError, match=r"closed by the module|broke"):
            client.wait(Event)
        with pytest.raises(LinkError, match="cannot be opened"), connected(links["top"]):
            pass


def test_latency_and_jitter_are_as_asked(simulate):
    with simulate("--latency-ms", 20, "--jitter-ms", 15, "--seed", 5).connected() as client:
        times = [client.ping() for _ in range(40)]
    assert min(times) >= 0.040
    assert 0.050 <= statistics.median(times) <= 0.060
    assert 0.055 < max(times) < 0.0701


def test_a_fault_of_one_module_leaves_the_others_alone(simulate):
    simulation = simulate(RIG, "--fault", "top:supply@0s")
    simulation.time.sleep(0.1)
    with simulation.connected("top") as client:
        assert client.ask(Arm(1)).code is Code.FAULT_PRESENT
    with simulation.connected("floor-1") as client:
        assert client.ask(Arm(1)).code is Code.OK


def test_a_client_that_goes_away_is_a_link_that_closed(simulate):
    simulation = simulate()
    with simulation.connected() as client:
        pull(client, ttl_ms=2000)
        assert client.ask(Hello(), Info).state is State.RUNNING
    simulation.time.sleep(0.2)  # far less than the time to live
    with simulation.connected() as client:
        assert client.ask(Hello(), Info).state is State.TIMEOUT
        assert client.ask(Stop()).state is State.IDLE


class TcpClient:
    """A client over a real socket, of a server that takes steps until what is waited for has come."""

    def __init__(self, connection, simulation):
        self.socket, self._simulation = connection, simulation

    def content(self):
        """What comes next; nothing, if that is the end."""
        end = time.monotonic() + HANG_S
        while time.monotonic() < end:
            self._simulation.time.step(1e-3)
            try:
                return self.socket.recv(1000)
            except BlockingIOError:
                continue
        raise TimeoutError

    def ping(self):
        self.socket.sendall(Ping(7).frame(1).pack())
        return [read(frame).echo for frame in Decoder().feed(self.content())]


@contextmanager
def tcp_client(simulation):
    host, _, port = simulation.links["module"].removeprefix("socket://").partition(":")
    with socket.create_connection((host, int(port)), timeout=HANG_S) as connection:
        connection.setblocking(False)
        yield TcpClient(connection, simulation)


def test_a_second_client_is_refused_and_the_first_does_not_notice(simulate):
    simulation = simulate()
    with tcp_client(simulation) as first:
        assert first.ping() == [7]
        with tcp_client(simulation) as second:
            assert second.content() == b""
        assert first.ping() == [7]
    with tcp_client(simulation) as third:
        assert third.ping() == [7]


def test_each_module_has_its_port_also_alone(simulate):
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    simulation = simulate(RIG, "--only", "top", "--port", free - 3)
    assert simulation.links == {"top": f"socket://127.0.0.1:{free}"}
    with pytest.raises(SystemExit) as left:
        main(["simulate", "--port", str(free)])
    assert left.value.code == 2
