"""What the stop button does, and what it says came of it."""

import os
from types import SimpleNamespace

import pytest

from tensionlab.errors import LinkError
from tensionlab.hardware.client.emergency_stop import RELEASE_TIMEOUT_S, Outcome
from tensionlab.support.operating_system import ESTOP_SIGNAL
from tensionlab.viewer import live
from tensionlab.viewer.live import stop_modules
from tests.helpers.simulated_time import SimulatedTime

PID = 4_000_000
LINKS = {"left": "socket://127.0.0.1:50001", "right": "socket://127.0.0.1:50002"}
SIMULATED = {"left": "sim:", "right": "sim:"}


class Watched:
    """Run as its watcher sees it; `after` its process is signalled."""

    def __init__(self, links, after="ended", unconfirmed=None, condition="live"):
        self.info = SimpleNamespace(links=links, pid=PID)
        self.condition, self.report = condition, SimpleNamespace(unconfirmed=unconfirmed or {})
        self.after, self.signals = after, []

    def kill(self, pid, number):
        self.signals.append((pid, number))
        self.condition = self.after


@pytest.mark.parametrize(
    ("outcomes", "confirmed", "lines"),
    [
        ({}, True, ("confirmed by 2 modules",)),
        ({"right": Outcome(None, "out of range")}, False, ("right: out of range", "confirmed by 1 module")),
    ],
)
def test_modules_with_links_are_stopped_by_the_emergency_stop(monkeypatch, outcomes, confirmed, lines):
    stopped = []

    def emergency_stop(links):
        stopped.append(links)
        return {name: outcomes.get(name, Outcome(None)) for name in links}

    monkeypatch.setattr(live, "emergency_stop", emergency_stop)
    assert stop_modules(Watched(LINKS)) == (confirmed, lines)
    assert stopped == [LINKS]


def test_an_emergency_stop_that_fails_is_told(monkeypatch):
    def refused(links):
        raise LinkError("/tmp: no folder for locks of modules")

    monkeypatch.setattr(live, "emergency_stop", refused)
    assert stop_modules(Watched(LINKS)) == (False, ("/tmp: no folder for locks of modules",))


@pytest.mark.parametrize(
    ("run", "signals", "confirmed", "line"),
    [
        (Watched(SIMULATED), [(PID, ESTOP_SIGNAL)], True, "confirmed by 2 modules"),
        (Watched(SIMULATED, unconfirmed={"left": "mute"}), [(PID, ESTOP_SIGNAL)], False, "left: mute"),
        # Another process may have its number by now.
        (Watched(SIMULATED, condition="ended"), [], True, "confirmed by 2 modules"),
        (Watched(SIMULATED, condition="gone"), [], True, "confirmed by 2 modules"),
    ],
)
def test_a_process_in_progress_is_signalled_to_stop_simulated_modules(run, signals, confirmed, line, monkeypatch):
    monkeypatch.setattr(live, "emergency_stop", lambda links: pytest.fail("they have no links"))
    monkeypatch.setattr(os, "kill", run.kill)
    outcome = stop_modules(run)
    assert (outcome.confirmed, outcome.lines[0], run.signals) == (confirmed, line, signals)


def test_a_process_that_does_not_report_that_its_modules_stopped_is_named(monkeypatch):
    run, passing = Watched(SIMULATED, after="stale"), SimulatedTime()
    monkeypatch.setattr(os, "kill", run.kill)
    monkeypatch.setattr(live, "time", passing)
    began = passing.perf_counter()
    outcome = stop_modules(run)
    assert passing.perf_counter() - began == pytest.approx(RELEASE_TIMEOUT_S, abs=0.1)
    assert not outcome.confirmed
    assert f"process {PID} was signalled and has not reported that its modules stopped" in outcome.lines[0]
    assert f"kill -9 {PID}" in outcome.lines[0]
    assert outcome.lines[1:] == ("confirmed by 0 modules",)


def test_a_process_that_may_not_be_signalled_is_named(monkeypatch):
    def refuse(pid, number):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "kill", refuse)
    outcome = stop_modules(Watched(SIMULATED))
    assert not outcome.confirmed
    assert outcome.lines[0] == f"process {PID} cannot be signalled: Operation not permitted"


def test_before_the_modules_are_known_nothing_is_said_to_have_stopped():
    run = Watched({})
    run.info = None
    assert not stop_modules(run).confirmed
