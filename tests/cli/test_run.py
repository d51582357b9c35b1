"""How a run ends by signals, and what it does where another process has its modules."""

import importlib
import os
import signal

import pytest

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import LinkLock
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import State
from tensionlab.operating_system import ESTOP_SIGNAL
from tests.support.reachable import ReachableRig

PATH = "datasets/rigs/bartels2026-validation.toml"


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


def test_a_second_host_is_refused_and_the_first_goes_on(run, reachable, monkeypatch, locks_folder):
    url = reachable.urls["top"]
    first = LinkLock(url)
    monkeypatch.delitem(OPENERS, url)  # a real link then, which is not opened
    code, out, err = run("run", PATH, "--modules", ",".join(reachable.urls.values()))
    assert (code, out) == (2, "")
    assert f"{url} is in use by process {os.getpid()} " in err
    assert {module.sample.state for module in reachable.world.modules} == {State.IDLE}
    first.release()
