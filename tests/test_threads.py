"""The threads that share a batch out: the same answers with many, beside other callers, and after a fork."""

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
