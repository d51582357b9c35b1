"""All modules of a rig let go at once, whoever has them."""

import os
import signal
from functools import partial

import pytest

import tensionlab as tl
from tensionlab.errors import LinkError, LinkTimeout
from tensionlab.hardware.client import emergency_stop as emergency
from tensionlab.hardware.client import locks
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import EmergencyStop
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.operating_system import ESTOP_SIGNAL
from tests.support.reachable import ReachableRig
from tests.support.scripts import running
from tests.support.simulated_time import START_S, SimulatedTime

HOST = """
import signal, sys
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.operating_system import ESTOP_SIGNAL
locks = [LinkLock(url) for url in sys.argv[2:]]
def stop(number, frame):
    for lock in locks:
        lock.release()
    sys.exit(3)
if sys.argv[1] == "handles":
    signal.signal(ESTOP_SIGNAL, stop)
print(flush=True)
sys.stdin.read()
"""
pytestmark = pytest.mark.usefixtures("locks_folder")


class LockedLink(SimulatedLink):
    """Link to a module of this process that one user at a time has, as real ones are."""

    def __init__(self, module, url):
        self._lock = LinkLock(url)
        super().__init__(module, url)

    def close(self):
        super().close()
        self._lock.release()


@pytest.fixture
def rig(monkeypatch):
    made = ReachableRig(monkeypatch, tl.load_rig("datasets/rigs/bartels2026-validation.toml"))
    for url, module in zip(made.urls.values(), made.world.modules, strict=True):
        monkeypatch.setitem(OPENERS, url, partial(LockedLink, module, url))
    return made


def states(rig):
    return [module.sample.state for module in rig.world.modules]


def test_modules_that_nobody_has_let_go(rig):
    assert {each.error for each in emergency_stop(rig.urls).values()} == {""}
    assert states(rig) == [State.ESTOP] * 4


@pytest.mark.realtime  # signals to a process that holds modules
@pytest.mark.parametrize("manner", ["handles", "ends by it"])
def test_modules_that_another_process_has_let_go_and_the_rest_too(rig, manner, monkeypatch):
    monkeypatch.setattr(emergency, "RELEASE_TIMEOUT_S", 60.0)
    with running(HOST, manner, *list(rig.urls.values())[:3]) as process:
        outcomes = emergency_stop(rig.urls)
        assert process.wait(60.0) == (3 if manner == "handles" else -signal.SIGUSR1)
    assert [each.holder and each.holder.pid for each in outcomes.values()] == [process.pid] * 3 + [None]
    assert {each.error for each in outcomes.values()} == {""}
    assert states(rig) == [State.ESTOP] * 4


class OtherProcess:
    """Process that has links, as this one sees it. A signal raises `ends`, or the links are free after it.

    Time passes only while somebody sleeps. `signals` are those it got.
    """

    PID = 4_000_000

    def __init__(self, monkeypatch, urls=(), seconds=0.0, ends=None):
        self.time, self.signals = SimulatedTime(), []
        self._seconds, self._ends, self._due = seconds, ends, None
        self._locks = [self.lock(url) for url in urls]
        self.time.watchers.append(self._look)
        monkeypatch.setattr(locks, "LOCK_TIMEOUT_S", 0.0)
        monkeypatch.setattr(emergency, "time", self.time)
        monkeypatch.setattr(os, "kill", self._kill)

    def lock(self, url):
        lock = LinkLock(url)
        note = locks._path(url).with_suffix(".json")
        note.write_text(note.read_text().replace(str(os.getpid()), str(self.PID)))
        return lock

    def _kill(self, pid, number):
        self.signals.append((pid, number))
        if self._ends is not None:
            raise self._ends
        self._due = self.time.perf_counter() + self._seconds
        self._look()

    def _look(self):
        if self._due is not None and self.time.perf_counter() >= self._due:
            for lock in self._locks:
                lock.release()

    @property
    def passed(self):
        return self.time.perf_counter() - START_S


def test_a_process_is_signalled_once_for_all_that_it_has(rig, monkeypatch):
    other = OtherProcess(monkeypatch, list(rig.urls.values())[:3])
    outcomes = emergency_stop(rig.urls)
    assert other.signals == [(other.PID, ESTOP_SIGNAL)]
    assert [each.holder and each.holder.pid for each in outcomes.values()] == [other.PID] * 3 + [None]
    assert {each.error for each in outcomes.values()} == {""}
    assert states(rig) == [State.ESTOP] * 4


@pytest.mark.parametrize("seconds", [5.9, 6.1])
def test_a_signalled_process_has_6_s_to_stop_its_modules_and_close_their_links(seconds, rig, monkeypatch):
    other = OtherProcess(monkeypatch, [rig.urls["top"]], seconds)
    [outcome] = emergency_stop({"top": rig.urls["top"]}).values()
    if seconds < 6.0:
        assert outcome.error == ""
        assert states(rig)[3] is State.ESTOP
    else:
        assert "was signalled, and still has it" in outcome.error
    assert other.passed == pytest.approx(min(seconds, 6.0), abs=0.02)


def test_one_that_cannot_be_signalled_is_not_waited_for(rig, monkeypatch):
    other = OtherProcess(monkeypatch, [rig.urls["top"]], ends=PermissionError(1, "Operation not permitted"))
    outcome = emergency_stop(rig.urls)["top"]
    assert outcome.error == f"process {other.PID} ({locks.program()}) cannot be signalled: Operation not permitted"
    assert other.passed <= 0.02
    assert states(rig)[:3] == [State.ESTOP] * 3


def test_one_that_has_ended_when_it_is_signalled_is_waited_for_as_if_it_had_heard(rig, monkeypatch):
    """The system takes a moment to close what it had."""
    other = OtherProcess(monkeypatch, [rig.urls["top"]], ends=ProcessLookupError())
    other._due = START_S + 0.5
    [outcome] = emergency_stop({"top": rig.urls["top"]}).values()
    assert outcome.error == ""
    assert other.passed == pytest.approx(0.5, abs=0.02)
    assert states(rig)[3] is State.ESTOP


def test_a_module_that_somebody_takes_at_that_moment_is_told_at_once(rig, monkeypatch):
    other, url = OtherProcess(monkeypatch), rig.urls["top"]
    taken = []
    monkeypatch.setitem(OPENERS, url, lambda: taken.append(other.lock(url)) or LinkLock(url))
    [outcome] = emergency_stop({"top": url}).values()
    assert outcome.holder is None
    assert outcome.error == f"process {other.PID} ({locks.program()}) has just taken it; try again"
    assert other.signals == []
    assert other.passed <= 0.02


def test_a_module_that_does_not_answer_is_named_and_tried_again_only_if_a_process_had_it(rig, monkeypatch):
    tries = []

    def silent(client, command, *timeouts):
        tries.extend([command] * isinstance(command, EmergencyStop))
        raise LinkTimeout('module "top" did not answer')

    monkeypatch.setattr(emergency.ModuleClient, "command", silent)
    other = OtherProcess(monkeypatch, [rig.urls["top"]])
    for count in (2, 1):
        [outcome] = emergency_stop({"top": rig.urls["top"]}).values()
        assert (outcome.error, len(tries)) == ('module "top" did not answer', count)
        tries.clear()
    assert len(other.signals) == 1


def test_a_module_that_is_let_go_while_it_is_being_opened(rig, monkeypatch):
    """Still taken when it is opened, free when one looks who has it."""
    url = rig.urls["top"]
    lock, real, tries = LinkLock(url), emergency.ModuleClient, []

    def open_late(name, link):
        tries.append(name)
        if len(tries) == 1:
            lock.release()
            raise LinkError(f"{url} is in use by process {os.getpid()}; end that first")
        return real(name, link)

    monkeypatch.setattr(emergency, "ModuleClient", open_late)
    monkeypatch.setattr(emergency, "_signal", lambda who: "")
    outcome = emergency_stop({"top": url})["top"]
    assert (outcome.holder.pid, outcome.error, len(tries)) == (os.getpid(), "", 2)
    assert states(rig)[3] == State.ESTOP


def test_a_process_that_does_not_let_go_is_named_and_the_rest_let_go(rig, monkeypatch):
    monkeypatch.setattr(emergency, "RELEASE_TIMEOUT_S", 0.1)
    monkeypatch.setattr(emergency, "_signal", lambda who: "")  # it is stopped, or ignores the signal
    lock = LinkLock(next(iter(rig.urls.values())))
    outcomes = list(emergency_stop(rig.urls).values())
    assert outcomes[0].error == (
        f"process {os.getpid()} ({locks.program()}) was signalled, and still has it; "
        f"end it (kill -9 {os.getpid()}), and its modules stop"
    )
    assert [each.error for each in outcomes[1:]] == [""] * 3
    assert states(rig) == [State.IDLE] + [State.ESTOP] * 3
    lock.release()


def test_a_process_does_not_signal_itself(rig, monkeypatch):
    monkeypatch.setattr(os, "kill", lambda pid, number: pytest.fail("it did"))
    lock = LinkLock(rig.urls["top"])
    [outcome] = emergency_stop({"top": rig.urls["top"]}).values()
    assert (outcome.holder.pid, outcome.error) == (os.getpid(), "this process has it")
    lock.release()


def test_one_that_cannot_be_reached_is_named():
    [outcome] = emergency_stop({"gone": "socket://127.0.0.1:1"}).values()
    assert outcome.error.startswith("socket://127.0.0.1:1 cannot be opened")


def test_without_a_word_all_that_processes_of_this_user_have(rig, run, monkeypatch):
    assert run("estop") == (1, "no process of yours uses a module; name the modules that are to stop\n", "")
    urls = list(rig.urls.values())[:2]
    taken = [LinkLock(url) for url in urls]
    monkeypatch.setattr(emergency, "_signal", lambda who: [lock.release() for lock in taken] and "")
    status, out, err = run("estop")
    assert (status, err) == (0, "")
    assert sorted(out.splitlines()) == [
        f"{url}: estop; process {os.getpid()} ({locks.program()}) had it" for url in urls
    ]
    assert states(rig) == [State.ESTOP] * 2 + [State.IDLE] * 2
    assert run("estop", list(rig.urls.values())[2], "socket://127.0.0.1:1")[0] == 1
    assert states(rig)[2] is State.ESTOP
