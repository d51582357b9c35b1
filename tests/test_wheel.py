"""The wheel, installed beside nothing but what it requires: what works, and what says which extra it needs."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import tensionlab
from tensionlab import _native
from tensionlab.benchmark.speed import describe_kernels

ROOT = Path(__file__).parents[1]
RIG = "bartels2026-validation"
BUILD = """
import sys
from scikit_build_core.build import build_wheel
build_wheel(sys.argv[1], {"wheel.cmake": "false"})
"""
SPACE = """
name = "corner"
counts = [4]
limits = { lower = 0.5, upper = 6.0 }
room = { size = [2.0, 2.0, 2.0] }
target = { x = [0.0, 0.1], y = [1.0, 1.1], z = [0.0, 0.1], step = 0.1 }
search = { generations = 1, starts = 1 }
"""
# Run several commands in one process, and print their exit statuses and what they said.
VERBS = """
import contextlib, dataclasses, io, json, sys
from tensionlab.cli import main
from tensionlab.benchmark import experiment
make = experiment.plan
experiment.plan = lambda *words: dataclasses.replace(make(*words), seconds=0.01)
found = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words)
        except SystemExit as end:
            found.append([end.code or 0, out.getvalue(), err.getvalue()])
print(json.dumps(found))
"""
WORK = [
    "allocate RIG --wrench 0 0 1.5",
    "allocate RIG --wrench 0 0 1.5 --solver qp:osqp --json",
    "compare RIG --plot compare.png --directions fibonacci:2 --solvers newton,closed-form",
    "compare RIG --directions fibonacci:2 --solvers newton,qp,qp:osqp --json",
    "rig check RIG",
    "rig show RIG --plot rig.png",
    "rig export RIG --out rig.xml",
    "datasets",
    "solvers",
    "datasets problems",
    "layout search space.toml --out found.toml",
    "run RIG --seconds 0.1",
    "module info sim:",
    "module config dump sim:",
    "module calibrate gain sim: --mass 0.1 --mass 0.2",
]  # what needs no extra
REFUSED = {
    "workspace RIG --step 0.5": "workspace",
    "workspace RIG --step 0.5 --out sweep.zarr": "workspace",
    "run RIG --log run.mcap": "hardware",
    "scenario bow": "hardware",
    "validate RIG --out validation": "data",
    "estop /dev/ttyUSB99": "hardware",
    "module discover": "hardware",
    "log info run.mcap": "hardware",
    "serve RIG": "haptics",
    "compare RIG --solvers qp:daqp": "solvers",
    "compare RIG --solvers cvxpy": "reference",
    "compare RIG --directions fibonacci:2 --out compare.parquet": "data",
    "problems edge --count 6 --out edge.parquet": "data",
    "bench --quick --set published --solvers newton --count 1 --out bench": "data",
    "allocate RIG --wrench 0 0 1.5 --solver qp:daqp": "solvers",
}  # what needs one, and which
EXTRAS = frozenset({"solvers", "data", "workspace", "cluster", "hardware", "haptics"})
COMPLETE = [
    "scenario bow --seconds 0.5 --log run.mcap --plot bow.png",
    "log info run.mcap",
    "validate RIG --out validation --preset ideal --hold 0.31",
    "bench --set published --solvers newton,daqp --count 1 --out bench",
    "workspace RIG --step 0.5 --out sweep.zarr",
    "serve RIG --seconds 0.1 --port 0 --osc 0",
    "compare RIG --directions fibonacci:2 --solvers newton,qp:daqp --out compare.parquet",
]  # what works with all extras but that of the reference ..
SUFFIXES = {".mcap", ".parquet", ".png", ".zarr"}  # ... and what it writes.
NOTEBOOK = """
import json, pathlib, sys
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
for cell in json.loads(pathlib.Path(sys.argv[1]).read_text(encoding="utf-8"))["cells"]:
    if cell["cell_type"] == "code":
        shell.run_cell("".join(cell["source"])).raise_error()
"""


def required(name: str, extras: frozenset[str] = frozenset()) -> Iterator[importlib.metadata.Distribution]:
    """Yield the distributions that an installation of this one brings, without itself."""
    seen: set[tuple[str, frozenset[str]]] = set()
    waiting = [(name, extras)]
    while waiting:
        each, wanted = waiting.pop()
        for line in importlib.metadata.requires(each) or []:
            needed = Requirement(line)
            marker = needed.marker
            if marker and not any(marker.evaluate({"extra": extra}) for extra in wanted or {""}):
                continue
            key = needed.name, frozenset(needed.extras)
            if key not in seen:
                seen.add(key)
                waiting.append(key)
                if needed.name != name:  # whose extras name others of its own
                    yield importlib.metadata.distribution(needed.name)


def environment(folder: Path, distributions: Iterable[importlib.metadata.Distribution]) -> Path:
    """Make a virtual environment that has these distributions of this one, and return where they are."""
    venv.create(folder, symlinks=True)
    (site,) = folder.glob("lib/python*/site-packages")
    for distribution in distributions:
        tops = {file.parts[0] for file in distribution.files or [] if ".." not in file.parts}
        for top in tops - {"__pycache__"} - {path.name for path in site.iterdir()}:
            (site / top).symlink_to(str(distribution.locate_file(top)))
    return site


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, without the kernels."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-c", BUILD, folder], cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """A virtual environment with the wheel and what it requires, no extra and nothing of the source tree.

    The C++ is not compiled again: the wheel has this interpreter's, as CMake would have installed it.
    """
    folder = wheel.parent
    site = environment(folder / "venv", required("tensionlab"))
    python = folder / "venv" / "bin" / "python"
    install = ["pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", "--no-compile", wheel]
    subprocess.run([sys.executable, "-m", *install], check=True, capture_output=True)
    shutil.copy(_native.__file__, site / "tensionlab")
    return folder / "venv"


def verbs(program: Path, commands: list[str]) -> dict[str, tuple[int, str, str]]:
    """Return exit status, stdout and stderr of each command, in the folder that the environment is in."""
    words = [command.replace("RIG", RIG).split() for command in commands]
    done = call(program, "-c", VERBS, json.dumps(words))
    assert done.returncode == 0, done.stderr
    return {command: tuple(said) for command, said in zip(commands, json.loads(done.stdout), strict=True)}


def call(program: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a program of the environment outside the source tree."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(word) for word in (program, *words)]
    return subprocess.run(
        command, cwd=program.parents[2], env=env, capture_output=True, text=True, check=False, timeout=600
    )


@pytest.fixture(scope="module")
def told(installed: Path) -> dict[str, tuple[int, str, str]]:
    """What each command says in the environment."""
    work = installed.parent
    (work / "space.toml").write_text(SPACE)
    (work / "modules.toml").write_text('[modules]\nbow-hand = "sim:"\n')
    (work / "run.mcap").write_bytes(b"")
    return verbs(installed / "bin" / "python", [*WORK, *REFUSED])


def test_its_command_says_which_version_it_is(installed: Path) -> None:
    done = call(installed / "bin" / "tensionlab", "--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"tensionlab {tensionlab.__version__}\n{describe_kernels()}\n"


def test_it_draws(installed: Path, told: dict[str, tuple[int, str, str]]) -> None:
    assert {code for code, _, _ in (told[command] for command in WORK)} == {0}
    for name in ("compare.png", "rig.png"):
        assert (installed.parent / name).stat().st_size > 10_000


@pytest.mark.parametrize("command", WORK)
def test_what_needs_no_extra_works(told: dict[str, tuple[int, str, str]], command: str) -> None:
    code, out, err = told[command]
    assert (code, "install" in err, "Traceback" in err) == (0, False, False)
    assert out


@pytest.mark.parametrize("command", REFUSED)
def test_what_needs_an_extra_names_it(told: dict[str, tuple[int, str, str]], command: str) -> None:
    code, _, err = told[command]
    last = err.strip().splitlines()[-1]
    assert f'pip install "tensionlab[{REFUSED[command]}]"' in last
    assert (code, len(last) <= 300, "Traceback" in err) == (2, True, False)


def with_extras(folder: Path, installed: Path, extras: frozenset[str], others: Iterable[str] = ()) -> Path:
    """Return the Python of an environment in that folder: the wheel with these extras, and other distributions."""
    more = [each for name in others for each in (importlib.metadata.distribution(name), *required(name))]
    site = environment(folder / "venv", [*required("tensionlab", extras), *more])
    for part in installed.glob("lib/python*/site-packages/tensionlab*"):
        (site / part.name).symlink_to(part)
    return folder / "venv" / "bin" / "python"


@pytest.mark.slow
@pytest.mark.parametrize("stem", ["01_allocation", "03_workspace", "06_validation"])
def test_a_notebook_needs_the_wheel_and_what_it_names(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stem: str
) -> None:
    path = ROOT / "notebooks" / f"{stem}.ipynb"
    first = "".join(json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"])
    named = re.search(r"tensionlab\[([a-z,]+)\]", first)
    extras = frozenset(named[1].split(",")) if named else frozenset()
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    done = call(with_extras(tmp_path, installed, extras, ["ipykernel"]), "-c", NOTEBOOK, path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_with_the_extras_all_verbs_work_in_another_folder(installed: Path, tmp_path: Path) -> None:
    done = verbs(with_extras(tmp_path, installed, EXTRAS), COMPLETE)
    assert {command: (code, err) for command, (code, _, err) in done.items() if code} == {}
    assert all(out for _, out, _ in done.values())
    files = [
        word
        for command in COMPLETE
        for word in command.split()
        if Path(word).suffix in {".mcap", ".png", ".zarr", ".parquet"}
    ]
    files += ["validation/report.md", "bench/report.md"]
    assert [name for name in files if not (tmp_path / name).exists()] == []


def test_it_has_the_package_with_its_data_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    package = [path.relative_to(ROOT) for path in (ROOT / "tensionlab").rglob("*") if path.is_file()]
    package = [path for path in package if "__pycache__" not in path.parts and path.suffix != ".so"]
    data = [path.relative_to(ROOT) for path in (ROOT / "datasets").rglob("*") if path.is_file()]
    expected = {path.as_posix() for path in package if path.parts[1] != "native"}
    expected |= {f"tensionlab/{path.relative_to(ROOT).as_posix()}" for path in (ROOT / "include").rglob("*.*")}
    expected |= {f"tensionlab/{path.as_posix()}" for path in data if path.suffix not in {".py", ".pyc"}}
    assert {name for name in names if ".dist-info/" not in name} == expected
    assert {"tensionlab/py.typed", "tensionlab/_native.pyi"} <= expected
    assert len([name for name in names if name.endswith(".dist-info/licenses/LICENSE")]) == 1


def test_what_is_compiled_in_keeps_its_licence() -> None:
    """As CMake installs it, in a wheel as in a clone."""
    files = importlib.metadata.files("tensionlab") or []
    licences = {file.parent.name: file.read_text() for file in files if file.name == "LICENSE"}
    assert "Wenzel Jakob" in licences["nanobind"]
    assert licences["robin_map"].startswith("MIT License\n\nCopyright (c) 2017 Thibaut Goetghebuer-Planchon")


def test_every_module_and_every_data_set_is_there_under_its_name(installed: Path) -> None:
    script = """
import importlib, json, pkgutil, tensionlab as tl
names = tl.datasets.names()
for name in names:
    try:
        assert name.startswith("problems/") or tl.datasets.load(name) is not None, name
    except tl.errors.MissingDependency as missing:  # tables are Parquet
        assert str(missing).endswith('pip install "tensionlab[data]"'), missing
        assert name.split("/")[0] not in {"rigs", "spaces"}, name
print(json.dumps([tl.__file__, tl.datasets.load("rigs/cogiro").name, names]))
for module in pkgutil.walk_packages(tl.__path__, "tensionlab."):
    if module.name != "tensionlab.__main__" and "interop.jax_" not in module.name:  # all of JAX
        importlib.import_module(module.name)
"""
    done = call(installed / "bin" / "python", "-c", script)
    assert done.returncode == 0, done.stderr
    file, name, names = json.loads(done.stdout)
    assert installed in Path(file).parents
    assert name == "cogiro"
    assert names == tensionlab.datasets.names()


def test_a_control_computer_needs_numpy_and_pydantic(installed: Path) -> None:
    """As `docs/get-started/install.md` has it: rig files, the exact solver, certificates and workspace metrics."""
    names = ["numpy", "pydantic", "tomli-w"]
    needed = [importlib.metadata.distribution(name) for name in names]
    control = installed.parent / "control"
    site = environment(control, [*needed, *(each for name in names for each in required(name))])
    (package,) = installed.glob("lib/python*/site-packages/tensionlab")
    (site / "tensionlab").symlink_to(package)
    script = f"""
import tensionlab as tl
rig = tl.load_rig("{RIG}")
structure = rig.structure_matrix(rig.home)
result = tl.allocate(structure, [1.0, 0.5, 1.0], rig.limits)
assert result.status == tl.Status.EXACT and abs(result.residual) < 1e-9
assert tl.allocate(structure, [9.0, 0.0, 0.0], rig.limits).status == tl.Status.NEAREST
assert tl.workspace.capacity_margin(structure, rig.limits) > -1
try:
    tl.allocate(structure, [1.0, 0.5, 1.0], rig.limits, solver="qp")
except tl.errors.MissingDependency as missing:
    print(missing)
"""
    done = call(control / "bin" / "python", "-c", script)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "QP backend 'clarabel' is not installed: pip install \"tensionlab[solvers]\"\n"
