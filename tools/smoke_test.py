"""Test an installed wheel in an empty folder: what a user tries first.

Needs nothing but the wheel and what it requires; cibuildwheel runs it on every wheel, without the repository's
folder: ``python tools/smoke_test.py``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import tensionlab as tl
from tensionlab import _native
from tensionlab.model.directions import grid18

RIG = "bartels2026-validation"
ROOT = Path(__file__).parents[1]


def main() -> None:
    """Allocate, compare and analyse; raise AssertionError or CalledProcessError where something is wrong."""
    package = Path(tl.__file__).parent
    assert not package.is_relative_to(ROOT), f"{package} is the repository, not an installed wheel"
    rig = tl.datasets.load(f"rigs/{RIG}")
    structure = rig.structure_matrix(rig.home)
    forces = 1.5 * grid18()

    found = tl.allocate(structure, forces, rig.limits)
    assert found.counts()[tl.Status.EXACT] == 182
    np.testing.assert_allclose(found.tensions @ structure.T, forces, atol=1e-9)
    proved = tl.allocate(structure, 10 * forces, rig.limits)
    assert proved.counts()[tl.Status.NEAREST] > 0
    assert proved.counts()[tl.Status.UNPROVEN] == proved.counts()[tl.Status.FAILED] == 0
    for solver in ("dykstra", "qp:clarabel", "qp:osqp"):
        other = tl.allocate(structure, forces, rig.limits, solver)
        np.testing.assert_allclose(other.tensions, found.tensions, atol=1e-6, err_msg=solver)

    assert tl.workspace.wrench_closure(structure) > 0
    margin = tl.workspace.capacity_margin(structure, rig.limits)
    inside = tl.allocate(structure, 0.999 * margin * grid18(), rig.limits)
    assert inside.counts()[tl.Status.EXACT] == 182

    with tempfile.TemporaryDirectory() as folder:
        for words in ("--version", f"compare {RIG} --plot compare.png", f"rig check {RIG}", "solvers", "--help"):
            command = [sys.executable, "-m", "tensionlab", *words.split()]
            subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        assert (Path(folder) / "compare.png").stat().st_size > 10_000
    print(f"works: {package}, Python {sys.version.split()[0]}, {_native.COMPILER}, {_native.INSTRUCTION_SET}")


if __name__ == "__main__":
    main()
