"""All modules of a rig let go at once, whoever has them."""

import os
import signal
from functools import partial

import pytest

import tensionlab as tl
from tensionlab.errors import LinkError
from tensionlab.hardware.client import emergency_stop as emergency
from tensionlab.hardware.client import locks
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.links import SimulatedLink
from tests.support.reachable import ReachableRig
from tests.support.scripts import running

HOST = """
import signal, sys
from tensionlab.hardware.client.locks import ESTOP_SIGNAL, LinkLock
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
        f"process {os.getpid()} ({locks._program()}) was signalled, and still has it; "
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
        f"{url}: estop; process {os.getpid()} ({locks._program()}) had it" for url in urls
    ]
    assert states(rig) == [State.ESTOP] * 2 + [State.IDLE] * 2
    assert run("estop", list(rig.urls.values())[2], "socket://127.0.0.1:1")[0] == 1
    assert states(rig)[2] is State.ESTOP
