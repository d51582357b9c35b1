"""A run as other processes read it, through a real publisher."""

import select
import socket

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.hardware import sharing
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.locks import MAX_SIMULATED, LinkLock, lock_simulated, locked_links
from tensionlab.hardware.client.shared_telemetry import Publisher
from tensionlab.hardware.protocol.codes import BrakeState, State
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.sharing import ASK_AGAIN_S, MIN_STALE_S, RunWatcher, find_runs
from tensionlab.hardware.simulation.world import World
from tests.helpers.simulated_time import SimulatedTime

PULL = Demand(np.array([0.0, 0.0, 1.5]))


@pytest.fixture
def published(monkeypatch):
    """Return the publisher of this process, which answers without a pause."""
    monkeypatch.setattr(shared_telemetry, "MIN_PERIOD_S", 0.0)
    made = Publisher()
    monkeypatch.setattr(shared_telemetry, "_publisher", made)
    return made


@pytest.fixture
def watcher(published):
    made = RunWatcher(published.port, published.token)
    yield made
    made.close()


@pytest.fixture
def passing(monkeypatch):
    made = SimulatedTime()
    monkeypatch.setattr(sharing, "time", made)
    return made


def wait(watcher):
    """Wait until something comes, or it is time to ask again; then poll."""
    select.select([watcher._watcher._socket], [], [], 2 * ASK_AGAIN_S)
    watcher.poll()


def hear(watcher, condition):
    """Poll until a report is as it should be; return it."""
    for _ in range(1000):
        watcher.poll()
        if watcher.report is not None and condition(watcher.report):
            return watcher.report
        wait(watcher)
    raise AssertionError("not heard")


def runner_of(name="bartels2026-validation", demand=lambda state: PULL, **how):
    rig = tl.load_rig(name)
    world = World(rig)
    settings = how.pop("settings", RunSettings())
    return world, Runner(rig, world.group(), "newton", demand, settings, clock=WorldClock(world), **how)


def test_the_newest_cycle_is_told_with_all_its_columns_and_what_is_not_logged(watcher):
    heard = []

    def demand(state):
        if state.cycle == 30:
            heard.append((runner.latest, hear(watcher, lambda report: report.cycles == 30), watcher.info))
        return PULL

    _, runner = runner_of(demand=demand)
    runner.run(1.0)
    [(latest, report, info)] = heard
    assert (info.rig.name, info.solver, info.rate) == ("bartels2026-validation", "newton", 50.0)
    assert info.links == dict.fromkeys((module.name for module in runner.rig.modules), "sim:")
    for name in COLUMNS:
        np.testing.assert_array_equal(report.cycle[name], COLUMNS[name].value(latest, runner.rig), err_msg=name)
    np.testing.assert_allclose(report.cycle["anchors"], runner.rig.anchors)
    assert report.cycle["brake_states"].tolist() == [BrakeState.OPEN] * 4
    assert [each.state for each in report.telemetry] == [State.RUNNING] * 4
    assert all(0.0 < each.current < 2.5 for each in report.telemetry)
    assert report.bad_frames.tolist() == [0] * 4
    assert report.start_delays.tolist() == list(runner.statistics.start_delays)[:30]
    assert [event.kind for event in report.events] == ["armed"]
    assert not report.over


def test_who_watched_is_told_the_end_unasked_and_who_comes_later_too(watcher, published):
    def demand(state):
        hear(watcher, lambda report: True)
        return PULL

    _, runner = runner_of(demand=demand)
    runner.run(0.2)
    watcher._watcher.ask = lambda topic: None
    report = hear(watcher, lambda report: report.over)
    assert (report.ended, report.emergency, report.cycles) == ("duration reached", False, 10)
    assert watcher.condition == "ended"
    late = RunWatcher(published.port, published.token)
    assert hear(late, lambda report: True).ended == "duration reached"
    late.close()


def test_a_run_that_fails_before_its_first_cycle_is_told_as_ended_and_the_next_takes_its_place(watcher):
    def fail(state):
        raise RuntimeError("no idea")

    _, runner = runner_of(demand=fail)
    with pytest.raises(RuntimeError):
        runner.run(1.0)
    report = hear(watcher, lambda report: True)
    assert (report.ended, report.over, report.cycle) == ("RuntimeError: no idea", True, None)
    runner_of("floor-3", lambda state: Demand())[1].run(0.1)
    second = hear(watcher, lambda later: later.number != report.number)
    assert (watcher.info.rig.name, second.over) == ("floor-3", True)


def test_a_lost_request_is_repeated_and_answers_that_make_no_sense_are_ignored(passing):
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.bind(("127.0.0.1", 0))
    watcher = RunWatcher(other.getsockname()[1], "token")
    for _ in range(2):
        watcher.poll()
        watcher.poll()
        request, address = other.recvfrom(100)
        assert request == b"token setup"
        passing.jump(1.5 * ASK_AGAIN_S)
    for content in (b"", b"null", b'{"rig": "x"}', b'{"number": 3}', b"\xff"):
        other.sendto(content, address)
        wait(watcher)
    assert (watcher.info, watcher.report) == (None, None)
    other.close()
    for _ in range(2):
        passing.jump(1.5 * ASK_AGAIN_S)
        watcher.poll()
    wait(watcher)
    assert watcher.condition == "gone", "its process ended unexpectedly"
    watcher.close()


def test_a_run_is_live_only_while_its_cycles_advance(watcher, passing):
    conditions = []

    def demand(state):
        if state.cycle == 5:
            hear(watcher, lambda report: report.cycles == 5)
            conditions.append(watcher.condition)  # a first cycle may be an old one
        if state.cycle == 10:
            passing.jump(1.5 * ASK_AGAIN_S)
            hear(watcher, lambda report: report.cycles == 10)
            conditions.append(watcher.condition)
            passing.jump(0.9 * MIN_STALE_S)
            watcher.poll()
            conditions.append(watcher.condition)
            passing.jump(0.2 * MIN_STALE_S)
            came = watcher._came
            while watcher._came == came:  # the process answers, but this cycle does not end
                passing.jump(1.5 * ASK_AGAIN_S)
                watcher.poll()
                wait(watcher)
            conditions.append(watcher.condition)
            assert watcher.age > MIN_STALE_S
        return PULL

    _, runner = runner_of(demand=demand)
    runner.run(0.4)
    assert conditions == ["waiting", "live", "live", "stale"]


def test_runs_are_found_by_the_locks_of_their_processes(published, locks_folder, monkeypatch):
    monkeypatch.setattr(sharing, "FIND_TIMEOUT_S", 600.0)
    assert find_runs() == []
    locks = [LinkLock("COM5"), LinkLock("COM6")]
    runner_of("floor-3", lambda state: Demand())[1].run(0.1)
    [found] = find_runs()
    assert found.info.rig.name == "floor-3"
    found.close()
    for lock in locks:
        lock.release()
    simulated = [lock_simulated() for _ in range(MAX_SIMULATED + 1)]
    assert simulated.pop() is None
    assert locked_links() == {}  # nothing for `estop` to command
    [found] = find_runs()
    found.close()
    for lock in simulated:
        lock.release()
