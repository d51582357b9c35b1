"""All modules of a rig let go at once, whoever has them."""

import signal
import time
from pathlib import Path

import pytest

from benchmarks.processes import simulated
from tensionlab.errors import LinkError
from tensionlab.hardware.client import emergency_stop as emergency
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import Clear, Hello, Info, Stop
from tests.support.scripts import running
from tests.support.wire import connected

RIG = Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml"
HOST = """
import signal, sys, time
from tensionlab.hardware.client.locks import ESTOP_SIGNAL
from tensionlab.hardware.client.module import ModuleClient
clients = [ModuleClient(url, url) for url in sys.argv[2:]]
def stop(number, frame):
    for client in clients:
        client.estop()
    for client in clients:
        client.close()
    sys.exit(3)
if sys.argv[1] == "handles":
    signal.signal(ESTOP_SIGNAL, stop)
if sys.argv[1] == "ignores":
    signal.signal(ESTOP_SIGNAL, signal.SIG_IGN)
for client in clients:
    client.arm()
print(flush=True)
while True:
    for client in clients:
        client.set_tension(2.0)
    time.sleep(0.05)
"""
pytestmark = [
    pytest.mark.realtime,  # signals to processes that hold modules
    pytest.mark.usefixtures("locks_folder"),
]


@pytest.fixture(scope="module")
def served():
    with simulated(RIG) as (found, _):
        yield found


@pytest.fixture
def links(served):
    yield served
    states(served)  # idle for the next test


def host(manner, urls):
    """Another process that has modules, and pulls with them."""
    return running(HOST, manner, *urls)


def states(links):
    """In which state is each? They are idle after it."""
    found = []
    for url in links.values():
        with connected(url) as client:
            found.append(client.ask(Hello(), Info).state)
            client.ask(Clear())
            client.ask(Stop())
    return found


def test_modules_that_nobody_has_let_go(links):
    assert {each.error for each in emergency_stop(links).values()} == {""}
    assert states(links) == [State.ESTOP] * 4


@pytest.mark.parametrize("manner", ["handles", "ends by it"])
def test_modules_that_another_process_has_let_go_and_the_rest_too(links, manner):
    with host(manner, list(links.values())[:3]) as process:
        outcomes = emergency_stop(links)
        assert process.wait(5.0) == (3 if manner == "handles" else -signal.SIGUSR1)
    assert [each.holder and each.holder.pid for each in outcomes.values()] == [process.pid] * 3 + [None]
    assert {each.error for each in outcomes.values()} == {""}
    assert states(links) == [State.ESTOP] * 4


def test_a_module_that_is_let_go_while_it_is_being_opened(links, monkeypatch):
    """Still taken when it is opened, free when one looks who has it."""
    url = links["top"]
    real, tries = emergency.ModuleClient, []

    def open_late(name, link):
        tries.append(name)
        if len(tries) == 1:
            process.send_signal(signal.SIGKILL)
            process.wait()
            raise LinkError(f"{url} is in use by process {process.pid}; end that first")
        return real(name, link)

    monkeypatch.setattr(emergency, "ModuleClient", open_late)
    monkeypatch.setattr(emergency, "_signal", lambda who: "")
    with host("ignores", [url]) as process:
        outcome = emergency_stop({"top": url})["top"]
    assert (outcome.holder.pid, outcome.error, len(tries)) == (process.pid, "", 2)
    assert states({"top": url}) == [State.ESTOP]


@pytest.mark.parametrize("hangs", [False, True])
def test_a_process_that_does_not_let_go_is_named_and_the_rest_let_go(links, hangs, monkeypatch):
    monkeypatch.setattr(emergency, "RELEASE_TIMEOUT_S", 0.5)
    manner = "handles" if hangs else "ignores"
    with host(manner, list(links.values())[:1]) as process:
        if hangs:
            process.send_signal(signal.SIGSTOP)
        outcomes = list(emergency_stop(links).values())
        assert outcomes[0].error.startswith(f"process {process.pid} (-c {manner} socket://")
        assert outcomes[0].error.endswith(f"still has it; end it (kill -9 {process.pid}), and its modules stop")
        assert [each.error for each in outcomes[1:]] == [""] * 3
    time.sleep(0.1)
    assert states(links) == [State.TIMEOUT] + [State.ESTOP] * 3


def test_one_that_cannot_be_reached_is_named():
    [outcome] = emergency_stop({"gone": "socket://127.0.0.1:1"}).values()
    assert outcome.error.startswith("socket://127.0.0.1:1 cannot be opened")


def test_without_a_word_all_that_processes_of_this_user_have(links, run):
    assert run("estop") == (1, "no process of yours uses a module; name the modules that are to stop\n", "")
    with host("ends by it", list(links.values())[:2]) as process:
        status, out, err = run("estop")
    assert (status, err) == (0, "")
    assert sorted(out.splitlines()) == sorted(
        f"{url}: estop; process {process.pid} (-c ends by it {' '.join(list(links.values())[:2])}) had it"
        for url in list(links.values())[:2]
    )
    assert states(links) == [State.ESTOP] * 2 + [State.IDLE] * 2
    assert run("estop", next(iter(links.values())), "socket://127.0.0.1:1")[0] == 1
    assert states(links)[0] is State.ESTOP
