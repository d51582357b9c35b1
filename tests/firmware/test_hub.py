"""The exact solver as a hub module would run it: in single precision, from the source that is cross-compiled."""

import ctypes
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl

HUB = Path(__file__).parents[2] / "firmware" / "hub"
SAME = 1e-4  # N
LOWER, UPPER = np.full(4, 0.5, np.float32), np.full(4, 6.0, np.float32)


@pytest.fixture(scope="module")
def allocate(tmp_path_factory):
    library = tmp_path_factory.mktemp("hub") / "hub.so"
    flags = [
        "-std=c++17",
        "-O2",
        "-shared",
        "-fPIC",
        "-fno-exceptions",
        "-fno-rtti",
        "-Wdouble-promotion",
        "-Werror",
    ]
    subprocess.run([shutil.which("c++"), *flags, str(HUB / "allocate.cpp"), "-o", str(library)], check=True)
    function = ctypes.CDLL(str(library)).allocate_tensions
    floats = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")
    function.argtypes = [ctypes.c_int, *5 * [floats]]

    def solve(structures, wrenches):
        tensions = np.empty((len(wrenches), 4), np.float32)
        steps = [
            function(4, structure, wrench, LOWER, UPPER, row)
            for structure, wrench, row in zip(structures, wrenches, tensions, strict=True)
        ]
        return tensions, max(steps)

    return solve


def test_float_answers_are_those_of_double_on_the_published_rig(allocate):
    structures, wrenches = runpy.run_path(str(HUB / "cycles.py"))["problems"](count=10_000, seed=1)
    found, most = allocate(structures, wrenches)
    exact = tl.allocate(structures, wrenches, (0.5, 6.0), nearest="force")
    reachable = exact.status == tl.Status.EXACT
    assert reachable.sum() > 5000
    assert (~reachable).sum() > 2000
    error = np.abs(found - exact.tensions).max(axis=1)
    assert error[reachable].max() < SAME
    # Out of reach the wrench is as near, though a few tensions are hard to tell in single precision.
    missed = np.linalg.norm(np.einsum("knm,km->kn", structures.astype(float), found) - wrenches, axis=1)
    assert (missed - exact.residual).max() < SAME
    assert np.quantile(error[~reachable], 0.99) < 2 * SAME
    assert ((found >= LOWER) & (found <= UPPER)).all()
    assert most < 150
