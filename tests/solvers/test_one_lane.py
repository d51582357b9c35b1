"""The exact solver's header in float with one lane, as the modules' own processor will run it."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl

ROOT = Path(__file__).parents[2]
STRUCTURE, LIMITS = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]]), (1.0, 10.0)
STRICT = ["-std=c++17", "-O2", "-fno-exceptions", "-fno-rtti", "-Wall", "-Wextra", "-Wconversion",
          "-Wdouble-promotion", "-Werror"]  # fmt: skip


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.fail("no C++ compiler 'c++' was found; the package itself needs one to build")
    program = tmp_path_factory.mktemp("one_lane") / "program"
    source = ROOT / "tests" / "data" / "one_lane.cpp"
    include = ROOT / "include"
    subprocess.run([compiler, *STRICT, f"-I{include}", str(source), "-o", str(program)], check=True)
    symbols = subprocess.run(["nm", "-C", "-u", str(program)], check=True, capture_output=True, text=True).stdout
    lines = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.split("\n")
    return symbols, np.array([line.split() for line in lines if line], dtype=float)


def test_it_compiles_strictly_and_never_asks_for_memory(answers):
    symbols, _ = answers
    assert "printf" in symbols
    for name in ("malloc", "operator new", "free", "__cxa_throw"):
        assert not any(line.split()[-1].startswith(name) for line in symbols.splitlines() if line), name


@pytest.mark.parametrize("index", range(3))
def test_it_gives_the_answers_of_the_double_solver(answers, index):
    _, found = answers
    for row, wrench in enumerate([(1, 2), (12, 6)]):
        policy = ("force", "tension", "direction")[index]
        exact = tl.allocate(STRUCTURE, wrench, LIMITS, policy=policy)
        np.testing.assert_allclose(found[2 * index + row, :3], exact.tensions, rtol=1e-3)  # of float
        assert found[2 * index + row, 3] < 60
