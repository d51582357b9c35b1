"""The guide docs/how-to/add-a-solver.md works and its solver keeps the style; a release has one version."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model.directions import grid18
from tests.helpers.distribution import install

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "how-to" / "add-a-solver.md").read_text(encoding="utf-8")
SOLVER, *OTHERS = re.findall(r"^```python\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
(TESTS,) = (code for code in OTHERS if "def test_" in code)
(PROJECT,) = re.findall(r"^```toml\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
FILE = "tensionlab/solvers/dual_ascent.py"


@pytest.fixture
def dual_ascent(monkeypatch: pytest.MonkeyPatch) -> type[Any]:
    """The guide followed: the solver is a module of the package and stands in the table."""
    module = ModuleType(FILE.removesuffix(".py").replace("/", "."))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(SOLVER, FILE, "exec"), module.__dict__)
    solver: type[Any] = module.__dict__["DualAscent"]
    monkeypatch.setitem(tl.SOLVERS, "dual-ascent", solver)
    return solver


@pytest.mark.usefixtures("dual_ascent")
@pytest.mark.parametrize(
    ("rig", "nearest_count"), [("bartels2026-validation", 0), ("bartels2026-validation-0.3m", 29)]
)
def test_it_agrees_with_the_exact_solver(rig: str, nearest_count: int) -> None:
    loaded = tl.load_rig(ROOT / "datasets" / "rigs" / f"{rig}.toml")
    structure, forces = loaded.structure_matrix(loaded.home), 1.5 * grid18()
    found = tl.allocate(structure, forces, loaded.limits, "dual-ascent", "middle", "force")
    exact = tl.allocate(structure, forces, loaded.limits, "newton", "middle", "force")
    assert found.counts()[tl.Status.EXACT] == 182 - nearest_count
    assert found.counts()[tl.Status.NEAREST] == nearest_count
    np.testing.assert_allclose(found.tensions, exact.tensions, rtol=0, atol=1e-6)


def test_it_refuses_what_it_cannot_do(dual_ascent: type[Any]) -> None:
    with pytest.raises(ValueError, match="supports 'force'"):
        tl.allocate([[1.0, -1.0]], [2.0], (1.0, 5.0), "dual-ascent", policy="direction")
    with pytest.raises(ValueError, match="iteration_limit=0"):
        dual_ascent(iteration_limit=0)


@pytest.mark.parametrize("text", [SOLVER, TESTS], ids=["solver", "tests"])
def test_it_keeps_the_style_of_the_house(text: str) -> None:
    name = FILE if text == SOLVER else "tests/solvers/test_dual_ascent.py"
    for command in (["check"], ["format", "--diff"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--stdin-filename", name, "-"]
        run = subprocess.run(ruff, cwd=ROOT, input=text, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr


@pytest.fixture
def outside(tmp_path: Path) -> dict[str, str]:
    """The second guide followed: an environment whose path has the solver as a distribution of its own."""
    project = tomllib.loads(PROJECT)
    (module,) = project["tool"]["setuptools"]["py-modules"]
    entries = project["project"]["entry-points"]["tensionlab.solvers"]
    install(tmp_path, project["project"]["name"], entries, {module: SOLVER}, project["project"]["version"])
    path = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path}


def test_from_outside_it_is_a_solver_like_any_other(outside: dict[str, str]) -> None:
    script = f"""{TESTS}
for test in [value for name, value in vars().items() if name.startswith("test_")]:
    test()
print(tl.allocate([[1.0, -1.0]], [2.0], (1.0, 5.0), "dual-ascent:200").tensions.round(3).tolist())
"""
    run = subprocess.run([sys.executable, "-c", script], env=outside, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "[3.0, 1.0]\n"), run.stderr


@pytest.mark.slow
def test_from_outside_it_is_held_against_the_contract(outside: dict[str, str]) -> None:
    (words,) = re.findall(r"`pytest (tests/test_contract\.py -k .*?)`", GUIDE)
    *rest, chosen = words.split()
    quick = f"{chosen} and not (equals or permuting or stronger)"  # half a minute, for so slow a solver
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *rest, quick]
    run = subprocess.run(command, cwd=ROOT, env=outside, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    (passed,) = re.findall(r"(\d+) passed", run.stdout)
    assert int(passed) >= 10


def test_a_release_has_one_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (cited,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    (built,) = re.findall(r"^project\(tensionlab VERSION (\S+) ", cmake, re.MULTILINE)
    assert tl.__version__ == project["version"] == cited == built


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make here")
@pytest.mark.parametrize(
    ("installed", "builds"), [((), "native"), (("user",), "native"), (("user", "dev"), "runnable")]
)
def test_the_kernels_of_the_tests_stay_whatever_is_installed_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, installed: tuple[str, ...], builds: str
) -> None:
    """`make docs` compiled for one instruction set what `make test` compares with the others."""
    for name in ("TENSIONLAB_BUILDS", "MAKEFLAGS", "MAKELEVEL"):  # the tests may run in make
        monkeypatch.delenv(name, raising=False)
    (tmp_path / ".venv").mkdir()
    for stamp in installed:
        (tmp_path / ".venv" / f"{stamp}.stamp").touch()
    words = ["make", "--file", ROOT / "Makefile", "--eval", "shown: ; @echo $$TENSIONLAB_BUILDS", "shown"]
    out = subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert out.split() == [builds]
