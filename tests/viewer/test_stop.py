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

    def __init__(self, links, after="ended", unconfirmed=None):
        self.info = SimpleNamespace(links=links, pid=PID)
        self.condition, self.report = "live", SimpleNamespace(unconfirmed=unconfirmed or {})
        self.after, self.signals = after, []

    def kill(self, pid, number):
        self.signals.append((pid, number))
        self.condition = self.after


@pytest.fixture
def stopped(monkeypatch):
    """What is stopped by its links, and the outcomes of that."""
    found = SimpleNamespace(links=None, outcomes={})

    def emergency_stop(links):
        found.links = links
        return {name: found.outcomes.get(name, Outcome(None)) for name in links}

    monkeypatch.setattr(live, "emergency_stop", emergency_stop)
    return found


def test_modules_with_links_are_stopped_by_the_emergency_stop(stopped):
    outcome = stop_modules(Watched(LINKS))
    assert stopped.links == LINKS
    assert (outcome.confirmed, outcome.lines) == (True, ("confirmed by 2 modules",))


def test_one_that_did_not_confirm_is_named_with_the_reason(stopped):
    stopped.outcomes["right"] = Outcome(None, "it is out of range")
    outcome = stop_modules(Watched(LINKS))
    assert not outcome.confirmed
    assert outcome.lines == ("right: it is out of range", "confirmed by 1 module")


def test_whatever_is_in_the_way_of_stopping_is_said(monkeypatch):
    def refused(links):
        raise LinkError("/tmp: no folder for locks of modules")

    monkeypatch.setattr(live, "emergency_stop", refused)
    outcome = stop_modules(Watched(LINKS))
    assert (outcome.confirmed, outcome.lines) == (False, ("/tmp: no folder for locks of modules",))


def test_a_process_is_told_to_stop_the_modules_that_it_simulates(monkeypatch, stopped):
    run = Watched(SIMULATED)
    monkeypatch.setattr(os, "kill", run.kill)
    outcome = stop_modules(run)
    assert stopped.links is None
    assert run.signals == [(PID, ESTOP_SIGNAL)]
    assert outcome.confirmed


def test_a_process_that_does_not_say_that_it_stopped_them_is_named(monkeypatch):
    run, passing = Watched(SIMULATED, after="stale"), SimulatedTime()
    monkeypatch.setattr(os, "kill", run.kill)
    monkeypatch.setattr(live, "time", passing)
    began = passing.perf_counter()
    outcome = stop_modules(run)
    assert passing.perf_counter() - began == pytest.approx(RELEASE_TIMEOUT_S, abs=0.1)
    assert not outcome.confirmed
    assert outcome.lines[0].startswith(
        f"process {PID} was signalled and has not reported that its modules stopped"
    )
    assert f"kill -9 {PID}" in outcome.lines[0]
    assert outcome.lines[1:] == ("confirmed by 0 modules",)


def test_what_the_run_says_did_not_stop_is_said(monkeypatch):
    run = Watched(SIMULATED, unconfirmed={"left": "no answer"})
    monkeypatch.setattr(os, "kill", run.kill)
    outcome = stop_modules(run)
    assert (outcome.confirmed, outcome.lines[0]) == (False, "left: no answer")


def test_a_process_that_may_not_be_signalled_is_named(monkeypatch):
    def refuse(pid, number):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "kill", refuse)
    outcome = stop_modules(Watched(SIMULATED))
    assert outcome.lines[0] == f"process {PID} cannot be signalled: Operation not permitted"


@pytest.mark.parametrize("condition", ["ended", "gone"])
def test_a_process_that_has_ended_is_not_signalled(condition, monkeypatch):
    """Another process may have its number by now."""
    run = Watched(SIMULATED)
    run.condition = condition
    monkeypatch.setattr(os, "kill", run.kill)
    assert stop_modules(run).confirmed
    assert run.signals == []


def test_before_it_is_known_what_there_is_nothing_is_said_to_have_stopped():
    run = Watched({})
    run.info = None
    assert not stop_modules(run).confirmed
