"""A run survives what does not come back: modules let go, the process ends with a reason, an emergency stop works.

Judged by causes, and by what the modules say; how soon it happens on this machine does not matter.
"""

import signal
from pathlib import Path

import pytest

from benchmarks.processes import simulated
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import Clear, Hello, Info, Stop
from tests.support.scripts import running
from tests.support.wire import connected

RIG = Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml"
HOST = """
import ctypes, dataclasses, signal, sys, time
import numpy as np
import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.errors import HardwareError
from tensionlab.hardware import Runner, connect
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.settings import RunSettings

def sleeps():
    time.sleep(1e6)

def spins():
    while True:
        try:
            while True:
                pass
        except Exception:
            pass

def locks(library):
    mutex = ctypes.create_string_buffer(64)
    library.pthread_mutex_lock(mutex)
    library.pthread_mutex_lock(mutex)  # never: no signal wakes it

HANGS = {"sleeps": sleeps, "spins": spins, "releases": lambda: locks(ctypes.CDLL(None)),
         "keeps": lambda: locks(ctypes.PyDLL(None))}

@dataclasses.dataclass(frozen=True)
class ThirdParty:
    policies = ("force",)
    def solve(self, problem):
        solved.append(1)
        if len(solved) == 20:
            print("hangs", flush=True)
            HANGS[sys.argv[1]]()
        return tl.solvers.make("newton").solve(problem)

solved = []
rig = tl.load_rig(sys.argv[2])
names = [module.name for module in rig.modules]
links = dict(zip(names, sys.argv[4:]))
group = connect(rig, links)
solver = ThirdParty()
log = RunLog(sys.argv[3], rig, {}, solver, RunSettings(), links)
runner = Runner(rig, group, solver, lambda state: Demand(np.array([0.0, 0.0, 0.5])), log=log)
print(flush=True)
try:
    runner.run()
except HardwareError as error:
    print(f"tensionlab: {error}", file=sys.stderr)
    group.close()
    sys.exit(1)
group.close()
print(runner.statistics.ended, flush=True)
sys.exit(3)
"""
pytestmark = [
    pytest.mark.realtime,  # processes that hang
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


def states(links):
    """In which state is each? They are idle after it."""
    found = []
    for url in links.values():
        with connected(url) as client:
            found.append(client.ask(Hello(), Info).state)
            client.ask(Clear())
            client.ask(Stop())
    return found


def hung(manner, links, tmp_path):
    """Return a process of a host whose solver hangs that way."""
    return running(HOST, manner, RIG, tmp_path / "run.mcap", *links.values())


@pytest.mark.parametrize(
    ("manner", "said"),
    [
        ("sleeps", "cycle 18 has not ended for 0.5 s, in sleeps (<string>:12): all modules are stopped"),
        ("spins", "cycle 18 has not ended for 0.5 s, in spins (<string>:1"),
        ("releases", "cycle 18 has not ended for 0.5 s, in locks (<string>:2"),
        ("keeps", "a native call keeps the interpreter and does not return, so the process ends"),
    ],
)
def test_a_solver_that_never_returns_ends_the_run_and_the_modules_let_go(links, tmp_path, capfd, manner, said):
    with hung(manner, links, tmp_path) as process:
        assert process.wait(30.0) == 1
    complaint = capfd.readouterr().err
    assert complaint.startswith(f"tensionlab: {said}")
    assert complaint.count("\n") == 1
    assert set(states(links)) <= {State.IDLE, State.TIMEOUT}
    if manner != "keeps":
        from tensionlab.hardware.log.reader import read_run

        run = read_run(tmp_path / "run.mcap")
        assert run.complete
        assert run.summary["ended"].startswith(said)
        assert run.events[-1].kind == "ended"


def test_a_signal_ends_a_run_whose_solver_hangs(links, tmp_path):
    with hung("releases", links, tmp_path) as process:
        assert process.stdout.readline() == "hangs\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) in (1, 3)
    assert set(states(links)) == {State.IDLE}


@pytest.mark.parametrize("manner", ["releases", "keeps"])
def test_an_emergency_stop_reaches_modules_whose_host_hangs(links, tmp_path, manner):
    with hung(manner, links, tmp_path) as process:
        assert process.stdout.readline() == "hangs\n"
        outcomes = emergency_stop(links)
        assert process.wait(30.0) in (1, 3)
    assert {each.error for each in outcomes.values()} == {""}
    assert {each.holder and each.holder.pid for each in outcomes.values()} == {process.pid}
    assert set(states(links)) == {State.ESTOP}
