"""Who may import whom, read off the imports; and that `import tensionlab` stays light."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tensionlab"

# Rooms that each room may enter, besides itself, `errors` and `arrays`.
ALLOWED = {
    "errors": set(),
    "arrays": set(),
    "model": set(),
    "solvers": {"_native"},
    "inputs": {"solvers", "_native"},
    "measure": {"solvers", "_native"},
    "allocation": {"inputs", "measure", "solvers", "_native"},
    "demand": {"model"},
    "records": set(),
    "workspace": {"model", "inputs", "allocation", "measure", "solvers", "records", "_native"},
    "hardware": {"model", "demand", "solvers", "measure", "allocation", "_native"},
    # Which brakes to lock, and how hard a cable that renders a spring must pull against the others.
    "haptics": {"model", "demand", "allocation", "solvers", "_native"},
    "experiments": {
        "_native",
        "records",
        "model",
        "demand",
        "solvers",
        "allocation",
        "measure",
        "workspace",
        "hardware",
        "haptics",
    },
    "plots": {"model", "solvers", "allocation", "measure", "workspace", "hardware", "experiments"},
    "cli": {
        "model",
        "demand",
        "solvers",
        "allocation",
        "measure",
        "workspace",
        "hardware",
        "haptics",
        "experiments",
        "plots",
        "records",
    },
    "datasets": {"model", "workspace", "experiments"},
    "__init__": {"model", "solvers", "allocation", "measure", "workspace", "hardware", "haptics", "datasets"},
    "__main__": {"cli"},
}
# One door for each third party, by file or folder of the package.
DOORS = {
    "qpsolvers": {"solvers/quadratic/backends.py", "solvers/quadratic/plain.py"},
    "osqp": {"solvers/quadratic/backends.py"},
    "clarabel": {"solvers/quadratic/backends.py"},
    "cvxpy": {"solvers/convex.py"},
    "cobs": {"hardware/frames.py"},
    "filelock": {"hardware/claims.py"},
    "highspy": {"experiments/highs.py"},
    "serial": {"hardware/link.py"},
    "websockets": {"haptics/bridge/server.py", "haptics/bridge/client.py"},
    "pythonosc": {"haptics/bridge/osc.py", "haptics/bridge/osc_tracker.py"},
    "mcap": {"hardware/record/mcap_file.py"},
    "zstandard": {"hardware/record/mcap_file.py"},
    "xarray": {"workspace/labels.py", "workspace/store.py", "hardware/record/dataset.py"},
    "zarr": {"workspace/store.py"},
    "distributed": {"workspace/run.py"},
    "matplotlib": {"plots"},
    "mpl_toolkits": {"plots"},
}
NATIVE = {
    "solvers/linear_program.py",
    "solvers/newton.py",
    "solvers/dykstra.py",
    "solvers/pseudoinverse.py",
    "solvers/closed_form.py",
    "solvers/polygon.py",
    "solvers/puncture.py",
    "solvers/analytic_centre.py",
    "solvers/slack_norm.py",
    "solvers/spidar.py",
    "inputs.py",
    "allocation.py",
    "measure.py",
    "experiments/bench/batches.py",
    "workspace/interference.py",
    "workspace/directions.py",
    "workspace/gradient.py",
    "workspace/margin.py",
    "workspace/measures.py",
    "workspace/wrench_set.py",
    "haptics/brakes.py",
    "hardware/run/pose_tracker.py",
    "hardware/simulated.py",
}
HEAVY = (
    "cvxpy",
    "matplotlib",
    "xarray",
    "zarr",
    "distributed",
    "qpsolvers",
    "osqp",
    "clarabel",
    "pyarrow",
    "scipy.optimize",
    "scipy.sparse",
    "pydantic",
)

FILES = sorted(PACKAGE.rglob("*.py"))
NAMES = [path.relative_to(PACKAGE).as_posix() for path in FILES]


def imported(tree: ast.Module) -> Iterator[str]:
    """Full names of all modules that a file imports at run time, wherever in the file."""
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        for statement in node.body
        for inner in ast.walk(statement)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imports_of(name: str) -> list[str]:
    return list(imported(ast.parse((PACKAGE / name).read_text())))


def room(name: str) -> str:
    return name.partition("/")[0].removesuffix(".py")


@pytest.mark.parametrize("name", NAMES)
def test_rooms(name: str) -> None:
    allowed = ALLOWED[room(name)] | {room(name), "errors", "arrays", "__version__"}
    for module in imports_of(name):
        package, _, rest = module.partition(".")
        if package == "tensionlab" and rest != "__version__":
            assert rest.partition(".")[0] in allowed, f"{name} imports {module}"


@pytest.mark.parametrize("name", NAMES)
def test_third_parties_have_one_door(name: str) -> None:
    for module in imports_of(name):
        doors = DOORS.get(module.split(".")[0])
        assert doors is None or {name, room(name)} & doors, f"{name} imports {module}"
        if module.startswith("tensionlab._native"):
            assert name in NATIVE, f"{name} imports {module}"


def test_the_rules_see_the_package() -> None:
    assert {"allocation.py", "errors.py", "solvers/newton.py", "model/rig.py"} <= set(NAMES)
    assert "qpsolvers" in imports_of("solvers/quadratic/backends.py")
    assert "tensionlab._native" in imports_of("solvers/newton.py")


@pytest.mark.parametrize("statement", ["import tensionlab", "import tensionlab.cli"])
def test_import_stays_light(statement: str) -> None:
    script = f"import sys; {statement}; print([name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
