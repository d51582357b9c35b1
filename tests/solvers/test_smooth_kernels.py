"""The compiled dual ascent behind `analytic-centre`, `slack` and `spidar`: lanes, threads, instruction sets."""

import os
import subprocess
import sys

import numpy as np
import pytest

import tensionlab as tl
from tests.helpers.examples import many
from tests.helpers.problems import random_cases

NAMES = ("analytic-centre", "slack", "slack:3", "spidar")

SCRIPT = """
import sys, numpy as np, tensionlab as tl
from tensionlab import _native
data = np.load(sys.argv[1])
print(_native.INSTRUCTION_SET)
answers = [tl.allocate(data["W"], data["w"], (data["a"], data["b"]), name).tensions for name in sys.argv[3:]]
np.save(sys.argv[2], np.array(answers))
"""


@pytest.mark.parametrize("name", NAMES)
def test_the_share_of_lanes_and_threads_does_not_change_an_answer(name, monkeypatch):
    batch = random_cases(1, 3, 6, 600)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "1")
    one = tl.allocate(batch.structure, batch.wrench, batch.limits, name)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    three = tl.allocate(batch.structure, batch.wrench, batch.limits, name)
    backwards = tl.allocate(
        batch.structure[::-1], batch.wrench[::-1], (batch.lower[::-1], batch.upper[::-1]), name
    )
    np.testing.assert_array_equal(one.tensions, three.tensions)
    np.testing.assert_array_equal(one.tensions, backwards.tensions[::-1])


def test_every_instruction_set_gives_the_same_answers(tmp_path):
    batch = random_cases(2, 6, 8, many(1000))
    problems = tmp_path / "problems.npz"
    np.savez(problems, W=batch.structure, w=batch.wrench, a=batch.lower, b=batch.upper)
    answers = {}
    for wish in ("baseline", "avx2", "avx512"):
        script = [sys.executable, "-c", SCRIPT, problems, tmp_path / "answers.npy", *NAMES]
        environment = {**os.environ, "TENSIONLAB_ISA": wish}
        taken = subprocess.run(script, env=environment, capture_output=True, text=True, check=True).stdout.strip()
        answers[taken] = np.load(tmp_path / "answers.npy")
    assert "baseline" in answers
    for answer in answers.values():
        for name, found, expected in zip(NAMES, answer, answers["baseline"], strict=True):
            accuracy = 1e-6 if name == "analytic-centre" else 1e-9  # it ends where its step is that small
            np.testing.assert_allclose(found, expected, rtol=0, atol=accuracy, err_msg=name)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_no_problem_takes_many_steps(name, n):
    for m in (1, 4, 8, 12, 32):
        batch = random_cases(m, max(n, 2), m, many(200))
        for stretch in (1.0, 1.5, 1e3, 1e9):
            found = tl.allocate(batch.structure[:, :n], stretch * batch.wrench[:, :n], batch.limits, name)
            assert found.iterations.max() <= 100
            assert np.all(np.isfinite(found.tensions))
