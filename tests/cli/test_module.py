"""`tensionlab module`, as a stranger would use it, on simulated modules of this process."""

import json
import os
import select
import signal
from pathlib import Path

import pytest

from tensionlab.errors import LinkError
from tensionlab.hardware.client import diagnostics as discover
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.client.locks import Holder, LinkLock
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.shared_telemetry import Publisher
from tensionlab.hardware.protocol.messages import ConfigureTelemetry
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.hardware.sharing import RunWatcher, SharedRun
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tests.helpers.modules import serial_port
from tests.helpers.reachable import ReachableRig

RIG = load_rig(Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml")


@pytest.fixture
def reach(monkeypatch):
    """Have a rig's modules over links of given conditions."""
    return lambda *conditions, seed=0: ReachableRig(monkeypatch, RIG, Conditions(*conditions), seed)


@pytest.fixture
def modules(reach):
    return reach()


@pytest.fixture
def urls(modules):
    return modules.urls


@pytest.fixture
def call(run, urls, tmp_path, simulated_time):
    """Run a verb on the rig's modules."""
    file = tmp_path / "modules-file.toml"
    file.write_text(modules_to_toml(urls))
    return lambda verb, *words: run("module", *verb.split(), "--modules", file, *words)


def test_info_shows_each_module_and_says_which_is_missing(run, call, urls):
    status, out, err = call("info")
    assert (status, err) == (0, "")
    assert [line.split()[:4] for line in out.splitlines()[3:]] == [
        [name, f"0000000{index}", "0.5", "idle"] for index, name in enumerate(urls, 1)
    ]
    status, out, err = run("module", "info", urls["top"], "socket://127.0.0.1:1", "--json")
    assert status == 1
    found = json.loads(out)
    assert found[0]["info"]["serial_number"] == 4
    assert found[0]["info"]["state"] == "IDLE"
    assert found[1]["info"] is None
    assert "cannot be opened" in found[1]["error"]
    assert err.startswith("tensionlab: socket://127.0.0.1:1 cannot be opened")


def test_discover_asks_what_looks_like_a_module_and_leaves_others_alone(run, monkeypatch, locks_folder, urls):
    ports = {
        urls["top"]: serial_port(urls["top"], "CP2102 USB to UART Bridge", "USB VID:PID=10C4:EA60", 0x10C4),
        urls["floor-1"]: serial_port(urls["floor-1"]),
        "/dev/rfcomm77": serial_port("/dev/rfcomm77"),
    }
    monkeypatch.setattr(discover, "serial_ports", lambda: list(ports.values()))
    status, out, _ = run("module", "discover", "--json")
    assert status == 0
    top, bluetooth = json.loads(out)
    assert top["url"] == urls["top"]
    assert top["info"]["serial_number"] == 4
    assert "cannot be opened" in bluetooth["problem"]
    lock = LinkLock(urls["floor-1"])
    status, out, _ = run("module", "discover", "--all")
    lock.release()
    assert status == 0
    assert f"in use by process {os.getpid()} (" in " ".join(out.split())
    assert "00000004" in out
    monkeypatch.setattr(discover, "serial_ports", list)
    status, out, _ = run("module", "discover")
    assert status == 1
    assert out == "no port looks like a module's; --all tries every serial port\n"


def test_ping_tells_percentiles_and_the_safe_rate(run, reach):
    urls = reach(0.02, 0.01).urls
    status, out, _ = run("module", "ping", *urls.values(), "--count", "50", "--json")
    assert status == 0
    for found in json.loads(out):
        assert (found["pings"], found["lost"], found["ttl"]) == (50, 0, 0.25)
        times = found["seconds"]
        assert 0.0 < times["p50"] <= times["p95"] <= times["p99"] <= times["max"] < 0.0605
        assert times["p50"] > 0.04
        least, most = found["safe_rate"]
        assert least == pytest.approx(3 / (0.25 - times["p99"] / 2))
        assert most == 1000.0
    status, out, _ = run("module", "ping", "--count", "5", urls["top"])
    assert status == 0
    assert out.splitlines()[-1].split()[:3] == [urls["top"], "5", "0"]
    assert "13 to 1000" in out


def test_monitor_shows_what_modules_say_and_what_it_means(call, urls):
    status, out, _ = call("monitor", "--seconds", "0.5")
    assert status == 0
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[3:7]] == list(urls)
    assert lines[6].split()[1:5] == ["idle", "0.00", lines[6].split()[3], "2.000"]
    assert "idle: the driver is off, or going off" in lines
    status, out, _ = call("monitor", "--seconds", "0.3", "--json", "top")
    [found] = json.loads(out)
    assert found["telemetry"]["limit"] == "IDLE"
    assert found["telemetry"]["length"] == pytest.approx(2.0, abs=1e-3)
    assert found["age"] < 0.2


def after_a_second(simulated_time, action):
    """Have something happen once, a second from now."""
    due = [simulated_time.perf_counter() + 1.0]

    def watch():
        if due and simulated_time.perf_counter() >= due[0]:
            due.clear()
            action()

    simulated_time.watchers.append(watch)


def test_monitor_says_when_a_module_is_gone(call, modules, urls, simulated_time):
    after_a_second(simulated_time, lambda: modules.cut("floor-2"))
    status, out, err = call("monitor", "--seconds", "5")
    assert status == 1
    shown = dict(line.split()[:2] for line in out.splitlines()[3:7])
    assert shown == dict.fromkeys(urls, "idle") | {"floor-2": "lost"}
    assert err == f"tensionlab: module 'floor-2': {urls['floor-2']} broke: it was cut\n"


@pytest.mark.parametrize(
    ("number", "ended"),
    [
        (signal.SIGINT, (130, "tensionlab: interrupted: nothing was changed; the same command watches again\n")),
        (signal.SIGTERM, (0, "")),
    ],
)
def test_ctrl_c_ends_the_monitor_in_good_order(call, modules, simulated_time, number, ended):
    began, before = simulated_time.perf_counter(), signal.getsignal(number)
    after_a_second(simulated_time, lambda: signal.raise_signal(number))
    status, out, err = call("monitor")
    assert (status, err) == ended
    assert "floor-1" in out
    assert simulated_time.perf_counter() - began < 1.5
    assert signal.getsignal(number) is before
    for link in modules.links.values():
        with pytest.raises(LinkError, match="is closed"):
            link.receive(0.0)


def test_identify_says_which_cable_pulses_and_why_one_cannot(run, call, urls):
    status, out, err = call("identify", "top")
    assert (status, out, err) == (0, f"top ({urls['top']}): its cable pulses now\n", "")
    assert json.loads(call("info", "top", "--json")[1])[0]["info"]["state"] == "IDLE"
    status, out, err = run("module", "identify", "sim:")
    assert (status, out) == (1, "")
    assert "is not calibrated; first `tensionlab module calibrate gain sim:`" in err


def test_stop_and_clear_say_in_which_state_that_leaves_modules(call, urls):
    names = list(urls)
    assert call("stop")[:2] == (0, "".join(f"{name}: idle\n" for name in names))
    with ModuleClient("top", urls["top"]) as client:
        client.estop()
    status, out, err = call("identify", "top")
    cure = f"find out why, then `tensionlab module clear {urls['top']}`"
    assert (status, out, err) == (1, "", f'tensionlab: module "top" is in ESTOP: {cure}\n')
    status, out, _ = call("stop", "top", "floor-1", "--json")
    assert status == 0
    assert [each["state"] for each in json.loads(out)] == ["ESTOP", "IDLE"]
    assert call("clear", "top")[:2] == (0, "top: idle\n")


def test_what_does_not_confirm_its_stop_is_named(run, urls):
    status, out, err = run("module", "stop", urls["top"], "socket://127.0.0.1:1")
    assert status == 1
    assert out == f"{urls['top']}: idle\n"
    assert err.startswith("tensionlab: socket://127.0.0.1:1 cannot be opened")
    assert err.count("\n") == 1


def test_parameters_from_one_module_to_a_file_and_back(call, tmp_path, urls):
    status, text, _ = call("config dump", "top")
    assert status == 0
    file = tmp_path / "top.toml"
    file.write_text(text)
    status, out, _ = call("config set", "top", "slew=50", "ttl=200")
    assert (status, out) == (0, "top: slew 60.0 -> 50.0\ntop: ttl 250.0 -> 200.0\n")
    status, out, _ = call("config get", "top", "slew", "--json")
    assert json.loads(out) == [{"module": "top", "url": urls["top"], "parameters": {"slew": 50.0}, "error": None}]
    status, out, _ = call(f"config restore {file}", "top", "--save")
    assert out == "top: slew 50.0 -> 60.0\ntop: ttl 200.0 -> 250.0\ntop: stored\n"
    assert call(f"config restore {file}", "top")[1] == "top: nothing to change\n"
    file.write_text("[parameters]\nspool_radius = 0.02\n")
    assert call(f"config restore {file}", "top")[1].splitlines() == [
        "top: spool_radius 0.0195 -> 0.02",
        "top: it no longer knows how long its cable is; calibrate that",
    ]
    file.write_text("[parameters]\nspool_radius = 2\n")
    status, out, err = call(f"config restore {file}", "top")
    assert (status, out) == (2, "")
    assert "top.toml: spool_radius is from 0.005 to 0.1 m; got 2" in err
    status, out, _ = call("config get", "top", "floor-1", "slew", "ttl")
    assert [line.split() for line in out.splitlines()[2:]] == [
        ["slew", "60.0", "60.0", "N/s"],
        ["ttl", "250.0", "250.0", "ms"],
    ]


OTHERS = {"floor-1": "socket://127.0.0.1:50001", "floor-2": "socket://127.0.0.1:50002", "floor-3": "COM7"}


@pytest.fixture
def elsewhere(monkeypatch):
    """Have a run in another process, as this one sees it by its notes; return who holds the modules, by URL."""
    monkeypatch.setattr(shared_telemetry, "MIN_PERIOD_S", 0.0)
    publisher = Publisher()
    monkeypatch.setattr(shared_telemetry, "_publisher", publisher)
    rig = load_rig("floor-3")
    clients = World(rig).group().clients
    for client, url in zip(clients, OTHERS.values(), strict=True):
        client.link.url = url
        client.command(ConfigureTelemetry(20))
        client.listen(0.1)
    SharedRun(rig, "newton", RunSettings(), clients)
    holders = dict.fromkeys(
        OTHERS.values(), Holder(4711, 1, "tensionlab run floor", "", publisher.port, publisher.token)
    )

    class Patient(RunWatcher):
        def poll(self):
            super().poll()
            select.select([self._watcher._socket], [], [], 60.0)

    verb = "tensionlab.cli.module_monitor"
    monkeypatch.setattr(f"{verb}.RunWatcher", Patient)
    monkeypatch.setattr(f"{verb}.holder", holders.get)
    monkeypatch.setattr(f"{verb}.locked_links", lambda: holders)
    return holders


@pytest.mark.usefixtures("elsewhere")
def test_monitor_shows_the_modules_of_a_run_as_that_one_hears_them(run, simulated_time):
    status, out, err = run("module", "monitor", "--seconds", "0.6")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[:3] for line in lines[3:6]] == [[name, "idle", "0.00"] for name in OTHERS]
    assert lines[-1] == f"as process 4711 (tensionlab run floor) receives them: {', '.join(OTHERS)}"
    status, out, _ = run("module", "monitor", "--seconds", "0.6", "--json", OTHERS["floor-2"])
    [found] = json.loads(out)
    assert (found["module"], found["url"], found["process"]) == ("floor-2", OTHERS["floor-2"], 4711)
    assert found["telemetry"]["state"] == "IDLE"
    assert found["age"] >= 0.0


def test_monitor_says_that_the_other_process_has_ended(run, elsewhere, monkeypatch, simulated_time):
    monkeypatch.setattr("tensionlab.cli.module_monitor.SILENCE_S", -1.0)
    after_a_second(simulated_time, elsewhere.clear)
    status, _, err = run("module", "monitor", "--seconds", "20", *OTHERS.values())
    assert status == 1
    assert "process 4711 (tensionlab run floor) has ended or released it; start the monitor again" in err
