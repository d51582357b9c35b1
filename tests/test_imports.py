"""Who may import whom, read off the imports; and that `import tensionlab` stays light."""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.helpers.windows import LACKING, NOT_THERE

PACKAGE = Path(__file__).parents[1] / "tensionlab"

# Rooms that each room may enter, besides itself and those of everybody.
EVERYBODY = {"errors", "support", "__version__"}
CORE = {"model", "allocation", "path_allocation", "demand", "_native"}
ABOVE = CORE | {
    "stiffest",
    "trajectory",
    "solvers",
    "verification",
    "datasets",
    "workspace",
    "hardware",
    "haptics",
    "scenarios",
}
ALLOWED = {
    "errors": set(),
    "support": {"_native"},
    "model": {"allocation"},  # Rig.allocate alone: see test_only_a_rig_allocates
    "solvers": {"_native"},
    "verification": {"solvers", "_native"},
    "allocation": {"verification", "solvers"},
    "gradients": {"allocation", "solvers", "_native"},
    "path_allocation": {"allocation", "solvers", "_native"},
    "stiffest": {"allocation", "model", "solvers", "_native"},
    "interop": CORE | {"gradients", "solvers", "hardware"},
    "jax": {"interop"},
    "torch": {"interop"},
    "mujoco": {"interop"},
    "lsl": {"interop"},
    "demand": {"model"},
    "trajectory": {"model", "workspace"},
    "workspace": CORE,
    "hardware": CORE,
    # Which brakes to lock, and how hard a cable that renders a spring must pull against the others.
    "haptics": CORE,
    "scenarios": CORE | {"haptics", "hardware"},
    "benchmark": ABOVE,
    "validation": ABOVE,
    "datasets": {"model", "workspace", "benchmark", "validation"},
    "plots": ABOVE | {"benchmark", "validation"},
    "viewer": ABOVE | {"benchmark", "validation", "interop"},
    "cli": ABOVE | {"benchmark", "validation", "plots", "viewer", "interop"},
    "__init__": ABOVE | {"benchmark", "gradients", "plots", "viewer"},
    "__main__": {"cli"},
}
# Folders of a room that may not enter these of its others.
CLOSED = {
    "hardware/protocol": ("client", "runner", "log", "simulation", "calibration"),
    "hardware/client": ("runner", "log", "simulation", "calibration"),
}
# A program of JAX in every line; a function of interop/jax.py imports it.
IN_JAX = {"interop/jax_dual.py", "interop/jax_scale_search.py", "interop/jax_solver.py"}

# One door for each third party, by file or folder of the package.
DOORS = {
    "qpsolvers": {"solvers/quadratic.py"},
    "osqp": {"solvers/quadratic.py"},
    "clarabel": {"solvers/quadratic.py"},
    "cvxpy": {"solvers/convex.py", "benchmark/baselines.py"},
    "filelock": {"support/files/writing.py"},
    "serial": {"hardware/client/links.py"},
    "websockets": {"haptics/bridge/server.py", "haptics/bridge/client.py", "viewer/server.py"},
    "viser": {"viewer/server.py"},
    "msgspec": {"viewer/server.py"},
    "skimage": {"support/surfaces.py"},
    "jinja2": {"viewer/html.py"},
    "pythonosc": {"haptics/bridge/osc.py"},
    "mcap": {"hardware/log/mcap_file.py"},
    "zstandard": {"hardware/log/mcap_file.py"},
    "xarray": {"support/provenance.py"},
    "pandas": {"support/provenance.py"},
    "zarr": {"workspace/sweep/store.py"},
    "distributed": {"workspace/sweep/executors.py"},
    "jax": {"interop/jax.py"} | IN_JAX,
    "torch": {"interop/torch.py"},
    "matplotlib": {"plots"},
    "mpl_toolkits": {"plots"},
    "mujoco": {"interop/mujoco.py"},
    "pylsl": {"interop/lsl.py"},
}
NATIVE = {
    "solvers/linear_program.py",
    "solvers/least_squares.py",
    "solvers/closed_form.py",
    "solvers/compiled.py",
    "solvers/penalty.py",
    "support/arrays.py",
    "gradients.py",
    "path_allocation.py",
    "stiffest.py",
    "verification.py",
    "benchmark/speed.py",
    "workspace/certification.py",
    "workspace/interference.py",
    "workspace/structure_metrics.py",
    "workspace/sweep/plan.py",
    "workspace/wrench_set.py",
    "haptics/rendering/assignment.py",
    "haptics/rendering/brakes.py",
    "haptics/rendering/field.py",
    "hardware/client/group.py",
    "hardware/client/links.py",
    "hardware/client/module.py",
    "hardware/protocol/codes.py",
    "hardware/protocol/messages.py",
    "hardware/runner/guard.py",
    "hardware/runner/armed_modules.py",
    "hardware/runner/body_clearance.py",
    "hardware/runner/state_estimation.py",
    "hardware/runner/watchdog.py",
    "hardware/simulation/simulated_module.py",
}
# Only support/operating_system.py uses what some systems lack, or asks which system this is. Steps of
# time.monotonic are 16 ms on Windows before Python 3.13; time.perf_counter is the same clock elsewhere.
SYSTEM_MODULES = {*NOT_THERE, "msvcrt", "winreg", "ctypes", "posix", "nt"}
SYSTEM_NAMES = {f"{module.__name__}.{name}" for module, names in LACKING.items() for name in names}
SYSTEM_NAMES |= {"sys.platform", "os.name", "platform.system", "os.kill", "time.monotonic", "signal.SIGBREAK"}
# Third parties that a file may import as it is imported itself. Optional libraries, and those that are slow to
# import, are imported where they are used: no room and no verb needs an extra until it does what the extra is for.
EAGER = {"numpy", "pydantic", "pydantic_core", "typer"}
HEAVY = (
    "cvxpy",
    "matplotlib",
    "pandas",
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


def imported(tree: ast.Module, *, types: bool = False) -> Iterator[str]:
    """Full names of all modules that a file imports at run time, or for types too, wherever in the file."""
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name | ast.Attribute)
        if ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        for statement in node.body
        for inner in ast.walk(statement)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only and not types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def at_import(body: list[ast.stmt]) -> Iterator[str]:
    """Top-level names that are imported as a file is: not inside functions, nor for type checkers only."""
    for node in body:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module).partition(".")[0]
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            yield from at_import(node.orelse)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for part in ("body", "orelse", "handlers", "finalbody"):
                yield from at_import(getattr(node, part, []))


@functools.cache
def parsed(name: str) -> ast.Module:
    return ast.parse((PACKAGE / name).read_text())


@functools.cache
def imports_of(name: str) -> list[str]:
    return list(imported(parsed(name)))


def room(name: str) -> str:
    return name.partition("/")[0].removesuffix(".py")


@pytest.mark.parametrize("entered", sorted({room(name) for name in NAMES}))
def test_rooms(entered: str) -> None:
    allowed = ALLOWED[entered] | EVERYBODY | {entered}
    for name in (name for name in NAMES if room(name) == entered):
        for module in imports_of(name):
            package, _, rest = module.partition(".")
            if package == "tensionlab" and rest != "__version__":
                assert rest.partition(".")[0] in allowed, f"{name} imports {module}"


def test_only_a_rig_allocates() -> None:
    for name in {name for name in NAMES if room(name) == "model"} - {"model/rig.py"}:
        assert not {module for module in imports_of(name) if module.startswith("tensionlab.allocation")}, name


@pytest.mark.parametrize("folder", CLOSED)
def test_folders_of_a_room(folder: str) -> None:
    closed = tuple(f"tensionlab.{room(folder)}.{other}." for other in CLOSED[folder])
    names = [name for name in NAMES if name.startswith(f"{folder}/")]
    assert names
    for name in names:
        for module in imports_of(name):
            assert not module.startswith(closed), f"{name} imports {module}"


def test_third_parties_have_one_door() -> None:
    for name, module in ((each, module) for each in NAMES for module in imports_of(each)):
        doors = DOORS.get(module.split(".")[0])
        assert doors is None or {name, room(name)} & doors, f"{name} imports {module}"
        if module.startswith("tensionlab._native"):
            assert name in NATIVE, f"{name} imports {module}"


def system_parts(tree: ast.Module) -> set[str]:
    """What a file uses that differs between systems."""
    used = {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)} | set(imported(tree))
    modules = {name for name in used if name.partition(".")[0] in SYSTEM_MODULES}
    # Whether a module has something is asked for no other reason.
    asked = {
        ast.unparse(node)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) in ("hasattr", "getattr")
        and ast.unparse(node.args[0]) in ("os", "select", "signal", "time")
    }
    return modules | used & SYSTEM_NAMES | asked


def test_what_differs_between_systems_is_in_one_file() -> None:
    found = {name: parts for name in NAMES if (parts := system_parts(parsed(name)))}
    assert found.keys() == {"support/operating_system.py"}, found


def test_the_rules_see_what_differs() -> None:
    text = "import tty\nfrom os import nice\nos.name\nhasattr(os, 'nice')\ntime.monotonic()\nselect.poll()\n"
    expected = {"tty", "os.nice", "os.name", "hasattr(os, 'nice')", "time.monotonic", "select.poll"}
    assert system_parts(ast.parse(text)) == expected
    assert "sys.platform" in system_parts(parsed("support/operating_system.py"))


def test_no_optional_library_is_imported_before_it_is_used() -> None:
    for name in NAMES:
        body = parsed(name).body
        third = set(at_import(body)) - sys.stdlib_module_names - {"tensionlab"}
        assert third <= EAGER | ({"jax"} if name in IN_JAX else set()), f"{name}: import them where they are used"
        eager = "".join(ast.unparse(each) for each in body if isinstance(each, ast.ImportFrom))
        assert name in IN_JAX or "jax_solver" not in eager


def test_one_file_touches_the_inside_of_viser() -> None:
    inside = {name for name in NAMES if any(re.match(r"viser\.(infra|_)", each) for each in imports_of(name))}
    assert inside == {"viewer/server.py"}
    private = re.compile(r"\b(viser|server|scene|gui)\._[a-z]")  # attributes of its objects
    files = {name for name in NAMES if name.startswith("viewer/") and private.search((PACKAGE / name).read_text())}
    assert files == {"viewer/server.py"}


def test_the_rules_see_what_is_imported_in_the_open() -> None:
    text = "try:\n    import filelock\nexcept ImportError:\n    import serial\ndef f():\n    import mcap\n"
    text += "if TYPE_CHECKING:\n    import zarr\nelse:\n    import rich.table\nclass A:\n    import xarray\n"
    assert set(at_import(ast.parse(text).body)) == {"filelock", "serial", "rich", "xarray"}


def test_the_rules_see_the_package() -> None:
    assert {"allocation.py", "errors.py", "solvers/least_squares.py", "model/rig.py"} <= set(NAMES)
    assert "qpsolvers" in imports_of("solvers/quadratic.py")
    assert "tensionlab._native" in imports_of("solvers/least_squares.py")


MODULE_NAME = re.compile(r"tensionlab(\.\w+){2,}")


def modules_imported(name: str) -> set[str]:
    """Modules of the package that a file imports, wherever in it, for types alone, or by a name in a string."""
    found = set()
    tree = parsed(name)
    strings = {str(node.value) for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    for module in [*imported(tree, types=True), *filter(MODULE_NAME.fullmatch, strings)]:
        package, *path = module.split(".")
        if package != "tensionlab" or path[:1] in (["_native"], ["__version__"]):
            continue
        for parts in (path, path[:-1]):
            if known := {"/".join(parts) + ".py", "/".join([*parts, "__init__.py"])} & set(NAMES):
                found |= known
                break
    return found - {name}


def test_no_module_imports_itself_through_others() -> None:
    graph = {name: modules_imported(name) for name in NAMES}
    assert {"allocation.py", "hardware/log/reader.py"} <= graph["plots/__init__.py"]  # named in strings alone
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the modules


@pytest.mark.parametrize("statement", ["import tensionlab", "import tensionlab.cli"])
def test_import_stays_light(statement: str) -> None:
    script = f"import sys; {statement}; print([name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_stop_waits_for_few_imports() -> None:
    script = """if True:
        import sys
        from tensionlab.cli import main
        try:
            main(["estop", "socket://127.0.0.1:1"])
        except SystemExit:
            print(*sys.modules)
        """
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    modules = run.stdout.split()
    assert "NOT CONFIRMED" in run.stderr
    assert not {"numpy", *HEAVY[:-1]} & set(modules)
    assert len([name for name in modules if name.startswith("tensionlab.")]) <= 32, modules
