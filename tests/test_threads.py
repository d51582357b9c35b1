"""The threads that share a batch out: the same answers with many, beside other callers, and after a fork; what is
thrown on them; and the signals that a batch hears."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import tensionlab as tl

SIZE = 20_000  # enough rows for three threads
LIMITS = (0.5, 6.0)


def problems(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(SIZE, 3, 6)), rng.normal(size=(SIZE, 3))


def test_callers_at_the_same_time_get_the_answers_that_they_get_alone(monkeypatch):
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    asked = [problems(seed) for seed in range(8)]
    alone = [tl.allocate(structure, wrench, LIMITS).tensions for structure, wrench in asked]
    with ThreadPoolExecutor(4) as callers:
        together = list(callers.map(lambda each: tl.allocate(*each, LIMITS).tensions, asked))
    np.testing.assert_array_equal(together, alone)


AFTER_A_FORK = """
import os, sys
import numpy as np, tensionlab as tl
from tests.test_threads import LIMITS, problems
structure, wrench = problems(0)
before = tl.allocate(structure, wrench, LIMITS).tensions
child = os.fork()
after = tl.allocate(structure, wrench, LIMITS).tensions
threads = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 3
if child == 0:
    os._exit(0 if np.array_equal(before, after) and threads >= 3 else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
def test_a_child_of_a_fork_has_threads_of_its_own(monkeypatch):
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    root = Path(__file__).parent.parent
    ended = subprocess.run(
        [sys.executable, "-c", AFTER_A_FORK], cwd=root, timeout=300, check=False, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted as Linux shows them")
def test_threads_are_made_once(monkeypatch):
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    structure, wrench = problems(1)
    tl.allocate(structure, wrench, LIMITS)
    before = len(list(Path("/proc/self/task").iterdir()))
    for _ in range(20):
        tl.allocate(structure, wrench, LIMITS)
    assert len(list(Path("/proc/self/task").iterdir())) == before


# In a process of their own: what is thrown on a thread and not caught there ends the process.


def run_python(program: str, **environment: str) -> str:
    ended = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parent.parent,
        env={**os.environ, "TENSIONLAB_NUM_THREADS": "2", **environment},
        timeout=300,
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, (ended.returncode, ended.stderr)
    return ended.stdout.strip()


CELLS = """
import numpy as np
from tensionlab import _native
def certify(centres, m, n=6):
    anchors, arms = np.random.default_rng(0).normal(size=(2, 1, m, 3))
    wrenches = np.zeros((1, 1, n))
    limits = np.zeros(m), np.full(m, 50.0)
    return _native.certify_cells(
        anchors, arms, *limits, wrenches, 1.0, 0.0, 0.0, 1.0, False, None, None, False,
        centres, np.full(3, 0.01), True,
    )
"""


def test_a_centre_that_is_not_contiguous_is_refused_whatever_the_threads():
    program = """
try:
    certify(np.zeros((10_000, 3))[::2], 8)
except ValueError as error:
    print(error)
"""
    assert run_python(CELLS + program) == "an array must be contiguous; copy it first"


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as on Linux")
def test_a_thread_without_memory_raises_memory_error_in_the_calling_one():
    program = """
import resource, time
from pathlib import Path
certify(np.zeros((5000, 3)), 8)  # the threads have been made
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 2**20, used + 2**20))
try:
    certify(np.zeros((5000, 3)), 32)  # 200,000 rays of 80 bytes
except MemoryError:
    time.sleep(0.5)  # for the other thread, which has no memory either
    print("MemoryError")
"""
    assert run_python(CELLS + program, MALLOC_ARENA_MAX="1") == "MemoryError"


# By the processor time of this process, in which the timer counts too: how busy the machine is does not matter.
INTERRUPTED = """
import signal, time
import numpy as np
import tensionlab as tl
rng = np.random.default_rng(0)
def end(number, frame):
    raise KeyboardInterrupt
def interrupt(batch):
    signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, 0.3)
    begin = time.process_time()
    try:
        batch()
    except KeyboardInterrupt:
        return time.process_time() - begin - 0.3
    raise SystemExit("the batch is too small to be interrupted")
"""
# Each is called for one problem first, since modules are loaded at the first call.
BATCHES = {
    "many problems": """
structure, wrench = rng.normal(size=(3, 8)), 10 * rng.normal(size=(2_000_000, 3))
tl.allocate(structure, wrench[0], (0.5, 6.0), solver="dykstra")
batch = lambda: tl.allocate(structure, wrench, (0.5, 6.0), solver="dykstra")
""",
    "one pose with many wrenches": """
structure, directions = rng.normal(size=(3, 32)), rng.normal(size=(1_000_000, 3))
tl.workspace.feasible_direction_fraction(structure, (0.5, 6.0), directions[:1], 5.0)
batch = lambda: tl.workspace.feasible_direction_fraction(structure, (0.5, 6.0), directions, 5.0)
""",
    "cells that take long": CELLS + "batch = lambda: certify(np.zeros((100, 3)), 32)\n",
    "a simulated module": """
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
batch = lambda: SimulatedModule().advance(20_000.0)
""",
}


@pytest.mark.skipif(sys.platform == "win32", reason="there is no timer of processor time")
@pytest.mark.parametrize("batch", BATCHES)
def test_a_batch_hears_a_signal_within_a_fifth_of_a_second(batch):
    late = run_python(INTERRUPTED + BATCHES[batch] + "print(interrupt(batch))", TENSIONLAB_NUM_THREADS="1")
    assert float(late) < 0.2
