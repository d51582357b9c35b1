"""Modules that a run reaches, how it ends by signals, and what it does where another process has its modules."""

import importlib
import os
import signal
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.cli.common.runs import reach_modules
from tensionlab.demand import Demand, Pose
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.support.operating_system import ESTOP_SIGNAL, usable_processors
from tests.helpers.reachable import ReachableRig

PATH = "datasets/rigs/bartels2026-validation.toml"
RIG = tl.load_rig(PATH)
NAMES = [module.name for module in RIG.modules]


@pytest.fixture
def reachable(monkeypatch, simulated_time):
    return ReachableRig(monkeypatch, tl.load_rig(PATH))


@pytest.mark.parametrize(
    ("number", "status", "said", "state"),
    [
        (signal.SIGINT, 130, "signal SIGINT", State.IDLE),
        (signal.SIGTERM, 0, "signal SIGTERM", State.IDLE),
        (signal.SIGHUP, 0, "signal SIGHUP", State.IDLE),
        (ESTOP_SIGNAL, 1, "emergency stop (from another terminal)", State.ESTOP),
    ],
)
def test_a_signal_ends_a_run_in_good_order(run, reachable, tmp_path, monkeypatch, number, status, said, state):
    def demand(now):
        if now.cycle == 30:
            assert {module.sample.state for module in reachable.world.modules} == {State.RUNNING}
            signal.raise_signal(number)
        return Demand()

    monkeypatch.setattr(importlib.import_module("tensionlab.cli.run"), "_demand", lambda *words: demand)
    log = tmp_path / "run.mcap"
    code, out, err = run("run", PATH, "--modules", ",".join(reachable.urls.values()), "--log", log)
    kept = f"all modules are stopped; {log} has the run until then; the next takes another --log"
    assert (code, err) == (status, f"tensionlab: interrupted: {kept}\n" if status == 130 else "")
    assert read_run(log).complete
    assert f"30 cycles, finished: {said}\n" in out  # on one line, however narrow the table
    assert {module.sample.state for module in reachable.world.modules} == {state}
    reachable.world.advance(0.1)  # cables are let go as slowly as tensions may change
    assert not any(module.sample.driver_on for module in reachable.world.modules)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has it")
def test_the_threads_of_a_run_in_real_time_are_scheduled_as_it_says(run, simulated_time, tmp_path, monkeypatch):
    def scheduled(pid):
        return os.sched_getscheduler(pid), os.sched_getaffinity(pid)

    def demand(state):
        found.append((scheduled(0), [scheduled(each.native_id) for each in threading.enumerate()[1:]]))
        return Demand()

    monkeypatch.setattr(importlib.import_module("tensionlab.cli.run"), "_demand", lambda *words: demand)
    log, before, found, last = tmp_path / "run.mcap", scheduled(0), [], usable_processors()[-1]
    status, _, err = run("run", PATH, "--real-time", last, "--seconds", 0.1, "--log", log)
    said = next(event.text for event in read_run(log).events if event.kind == "scheduling")
    assert status == 0
    assert err.endswith(f"\nreal-time scheduling: {said}\n")
    policy = before[0] if "SCHED_FIFO with priority 40 was refused" in said else os.SCHED_FIFO
    for own, others in found:
        assert own == (policy, {last})
        assert len(others) >= 2  # the watchdog's and the log's: neither waits for the run's
        assert all(each == before for each in others)
    assert scheduled(0) == before


def test_a_processor_that_is_not_there_is_refused_before_anything_starts(run):
    status, out, err = run("run", PATH, "--real-time", 100_000)
    assert (status, out) == (2, "")
    assert err.startswith("tensionlab: this process may use the processors ")
    assert "simulating" not in err


def test_a_second_host_is_refused_and_the_first_goes_on(run, reachable, monkeypatch, locks_folder):
    url = reachable.urls["top"]
    first = LinkLock(url)
    monkeypatch.delitem(OPENERS, url)  # a real link then, which is not opened
    code, out, err = run("run", PATH, "--modules", ",".join(reachable.urls.values()))
    assert (code, out) == (2, "")
    assert f"{url} is in use by process {os.getpid()} " in err
    assert {module.sample.state for module in reachable.world.modules} == {State.IDLE}
    first.release()


def test_the_end_of_a_run_says_what_was_desired_and_what_came_of_it(run, simulated_time):
    status, out, _ = run("run", PATH, "--force", 0, 0, 50, "--seconds", 1)
    assert status == 0
    rows = dict(line.split("  ", 1) for line in out.splitlines()[1:] if "  " in line)
    assert "50 NEAREST; NEAREST: what is desired is infeasible" in " ".join(out.split())
    assert rows["desired in the last cycle"].strip() == "( 0.00,  0.00, 50.00) N"
    assert rows["commanded in the last cycle"].strip() == "(-0.08, -0.02,  4.22) N"
    assert rows["measured in the last cycle"].strip() == "(-0.08, -0.02,  4.22) N"


def test_what_the_rig_requires_is_told_and_measured(run, simulated_time, tmp_path):
    heavy = replace(
        tl.load_rig(PATH), platform=tl.Platform(0.1), required=tl.Requirement(box=[0.1] * 3, gravity=True)
    )
    tl.save_rig(heavy, tmp_path / "heavy.toml")
    status, out, err = run("run", tmp_path / "heavy.toml", "--seconds", 1)
    assert status == 0
    assert "the cables also hold what bartels2026-validation requires: its weight of 0.1 kg\n" in err
    assert "0.98" in next(line for line in out.splitlines() if line.startswith("measured in the last cycle"))


def test_without_a_word_they_are_simulated_and_hold_what_moves(capsys, simulated_time):
    place = RIG.home + np.array([0.1, 0.0, 0.0])
    group, clock, links = reach_modules(RIG, None, lambda time: Pose(place))
    assert capsys.readouterr().err == "No --modules given: simulating them in this process.\n"
    assert links == dict.fromkeys(NAMES, "sim:")
    group.prepare(RIG, 10)
    clock.wait_until(clock.now() + 0.1)
    for client in group.clients:
        client.listen()
    found = [client.telemetry.message.length for client in group.clients]
    np.testing.assert_allclose(found, RIG.lengths(place), atol=1e-3)
    group.close()


def test_links_are_those_of_the_modules_in_the_rigs_order(capsys, monkeypatch, simulated_time):
    reachable = ReachableRig(monkeypatch, RIG)
    urls = [reachable.urls[name] for name in NAMES]
    group, clock, links = reach_modules(RIG, " , ".join(urls), None)
    assert list(links.items()) == list(zip(NAMES, urls, strict=True))
    assert [client.hello().serial_number for client in group.clients] == [1, 2, 3, 4]
    assert isinstance(clock, RealClock)
    before = [module.seconds for module in reachable.world.modules]
    clock.wait_until(clock.now() + 0.1)
    passed = np.subtract([module.seconds for module in reachable.world.modules], before)
    np.testing.assert_allclose(passed, 0.1, atol=1e-3)
    group.close()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("value", ["-1", "0", "nan", "inf"])
def test_rates_and_times_are_finite_and_above_0(run, value):
    for words in (
        *(("run", PATH, option) for option in ("--seconds", "--rate", "--ttl")),
        *(("serve", PATH, option) for option in ("--seconds", "--rate")),
        ("serve", "--scenario", "bow", "--rate"),
        ("scenario", "bow", "--seconds"),
    ):
        status, out, err = run(*words, value)
        assert (status, out) == (2, "")
        assert words[-1] in err
        assert f"got {float(value):g}" in err
