"""Solvers that do not return: modules release, the process ends with a reason, an emergency stop works.

Judged by causes, and by what the modules say; how soon it happens on this machine does not matter.
"""

import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.client import emergency_stop as emergency
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.runner.settings import RunSettings
from tests.helpers.rehearsal import Rehearsal
from tests.helpers.scripts import running
from tests.helpers.serving import TIMEOUT_S, ServedRig

PATH = Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml"
RIG = tl.load_rig(PATH)
HOST = """
import ctypes, dataclasses, sys
from pathlib import Path
import numpy as np
import tensionlab as tl
from tensionlab.hardware import Demand, RunLog, Runner, RunSettings, connect
from tensionlab.hardware.client import locks as link_locks

def locks(library):
    mutex = ctypes.create_string_buffer(64)
    library.pthread_mutex_lock(mutex)
    library.pthread_mutex_lock(mutex)  # never: no signal wakes it

LIBRARIES = {"releases": ctypes.CDLL, "keeps": ctypes.PyDLL}

@dataclasses.dataclass(frozen=True)
class ThirdParty:
    policies = ("force",)
    def solve(self, problem):
        solved.append(1)
        if len(solved) == 20:
            print("hangs", flush=True)
            locks(LIBRARIES[sys.argv[1]](None))
        return tl.solvers.make("newton").solve(problem)

solved = []
link_locks.user_folders = lambda: [Path(sys.argv[3]).with_name("locks")]  # as `locks_folder` has it
rig = tl.load_rig(sys.argv[2])
links = dict(zip((module.name for module in rig.modules), sys.argv[4:]))
group, solver, settings = connect(rig, links), ThirdParty(), RunSettings(ttl=1.0)
log = RunLog(sys.argv[3], rig, {}, solver, settings, links)
runner = Runner(rig, group, solver, lambda state: Demand(np.array([0.0, 0.0, 0.5])), settings, sinks=[log])
print(flush=True)
runner.run()
group.close()
sys.exit(3)
"""
pytestmark = pytest.mark.usefixtures("locks_folder")


def sleeps():
    time.sleep(TIMEOUT_S)


def spins():
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        try:
            while time.monotonic() < end:
                pass
        except Exception:
            pass


@dataclass(frozen=True)
class Hangs:
    """Solver that does something else in its 20th call."""

    hang: object
    solved: list = field(default_factory=list)
    policies = ("force",)

    def solve(self, problem):
        self.solved.append(1)
        if len(self.solved) == 20:
            self.hang()
        return tl.solvers.make("newton").solve(problem)


@pytest.mark.parametrize("hang", [sleeps, spins])
def test_a_solver_that_hangs_in_python_is_interrupted_and_the_modules_are_stopped(tmp_path, hang):
    rehearsal, solver = Rehearsal(RIG, trouble_at=1e9), Hangs(hang)

    class Watched:
        real_time = True
        now, wait_until = rehearsal.clock.now, rehearsal.clock.wait_until

    log = RunLog(tmp_path / "run.mcap", RIG, {}, solver, RunSettings(), dict.fromkeys(rehearsal.links, "sim:"))
    why = f"cycle 18 has not ended for 0.5 s, in {hang.__name__} (test_hung.py:"
    with pytest.raises(HardwareError) as caught:
        rehearsal.runner(rehearsal.demand(), solver, [log], Watched()).run()
    assert str(caught.value).startswith(why)
    assert str(caught.value).endswith("): all modules are stopped")
    assert set(rehearsal.states().values()) == {"IDLE"}
    run = read_run(tmp_path / "run.mcap")
    assert run.complete
    assert run.summary["ended"] == str(caught.value)
    assert run.events[-1].kind == "ended"


@pytest.fixture
def rig():
    with ServedRig(RIG) as served:
        yield served


def hung(manner, rig, tmp_path):
    """Return a process whose solver hangs in a native call that releases the interpreter, or keeps it."""
    return running(HOST, manner, str(PATH), str(tmp_path / "run.mcap"), *rig.links.values())


def released_states(rig):
    """Return the states of the modules once none follows set-points any more."""
    rig.wait_for(lambda row: not {State.RUNNING, State.ARMED} & set(row.states))
    return set(rig.rows[-1].states)


@pytest.mark.realtime  # a process whose native call does not return
@pytest.mark.parametrize(
    ("manner", "said"),
    [
        ("releases", "cycle 18 has not ended for 1 s, in locks (<string>:"),
        ("keeps", "a native call keeps the interpreter and does not return, so the process ends"),
    ],
)
def test_a_native_call_that_never_returns_ends_the_process_and_modules_let_go(rig, tmp_path, capfd, manner, said):
    with hung(manner, rig, tmp_path) as process:
        assert process.wait(TIMEOUT_S) == 1
    complaint = capfd.readouterr().err
    assert complaint.startswith(f"tensionlab: {said}")
    assert complaint.count("\n") == 1
    assert released_states(rig) <= {State.IDLE, State.TIMEOUT}
    if manner == "releases":
        run = read_run(tmp_path / "run.mcap")
        assert run.complete
        assert run.summary["ended"].startswith(said)
        assert run.events[-1].kind == "ended"


@pytest.mark.realtime  # a signal to a process whose native call does not return
def test_a_signal_ends_a_run_whose_solver_hangs(rig, tmp_path):
    with hung("releases", rig, tmp_path) as process:
        assert process.stdout.readline() == "hangs\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(TIMEOUT_S) in (1, 3)
    assert released_states(rig) == {State.IDLE}


@pytest.mark.realtime  # an emergency stop of a process whose native call does not return
@pytest.mark.parametrize("manner", ["releases", "keeps"])
def test_an_emergency_stop_reaches_modules_whose_host_hangs(rig, tmp_path, manner, monkeypatch):
    monkeypatch.setattr(emergency, "RELEASE_TIMEOUT_S", TIMEOUT_S)
    with hung(manner, rig, tmp_path) as process:
        assert process.stdout.readline() == "hangs\n"
        outcomes = emergency_stop(rig.links)
        assert process.wait(TIMEOUT_S) in (1, 3)
    assert {each.error for each in outcomes.values()} == {""}
    assert {each.holder and each.holder.pid for each in outcomes.values()} == {process.pid}
    rig.wait_for(lambda row: set(row.states) == {State.ESTOP})
