"""The notebooks run from top to bottom without an error or a warning and show what is stored in them, and their
exercises can be solved. `tests/test_wheel.py` runs some of them where only the wheel and its extras are."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.core.pylabtools import activate_matplotlib, select_figure_formats
from IPython.utils.capture import capture_output
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from matplotlib_inline.backend_inline import configure_inline_support
from nbclient import NotebookClient
from traitlets.config import Config

import tensionlab
from tools.notebooks import NOTEBOOKS, TIME, differ, lasting_outputs, shown

LARGEST = 300_000  # bytes of a notebook
MACHINE = re.compile(rf"{TIME.pattern}|/tmp/|\b0x[0-9a-f]{{6}}")  # times, files, addresses
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
# The backend with which kernels show figures below their cells.
INLINE = "module://matplotlib_inline.backend_inline"
# Pictures through files, what only a clone has, and settings that outlast their cell.
NO_IDIOMS = ("Image(", "root =", 'Path("..', "style.use", "set_printoptions", "rcParams")
EXERCISE = re.compile(r"\d\. \S[^\n]*\n   \*Hint:\* [^\n]*\S")
SOLUTIONS = {
    "01_allocation": """
found = tl.allocate(rig.structure_matrix(rig.home), [10.0, 5.0, 10.0], rig.limits, policy="direction")
assert round(15 * found.scale, 2) == 4.15
worst = many.residual.argmax()
assert many.status[worst] == tl.Status.NEAREST and abs(grid18()[worst, 1]) < 0.4  # nearly sideways
assert tl.allocate(W, force, (0.0, 6.0)).status == tl.Status.EXACT
""",
    "02_solver_benchmark": """
solved = table.loc["near-singular"].query("solved_1e9 == 1")
assert ("newton", "proved") in solved.index and ("daqp", "tight") not in solved.index
osqp = table.loc["edge", "qpsolvers:osqp", "default"]
assert osqp["solved_1e6"] < 0.5 and 0.01 < osqp["error_max"] < 2.0
times = table["median_s"].groupby(level=["solver", "problem_set"]).min().unstack()
longer = times["edge"] / times["point"]
assert longer["dykstra"] > 1.3 and longer["newton"] < 1.2
""",
    "03_workspace": """
published = tl.workspace.Grid(*(swept[axis].to_numpy() for axis in "xyz"))
found = tl.workspace.summary(tl.sweep(rig, published, "capacity-margin:2"))
assert round(100 * found["above_zero"][0], 1) == 2.1
stronger = tl.workspace.vary(rig, limits=[(0.5, 6), (0.5, 12)])
medians = tl.workspace.summary(tl.sweep(stronger, cube, "capacity-margin"))["median"]
assert 2.1 < medians[1] / medians[0] < 2.3  # the minimum tension costs less of it
poses = tl.workspace.Grid(np.linspace(-4, 4, 81), np.linspace(-3, 3, 61), [1.0])
assert tl.sweep(ipanema, poses, "wrench-closure")["wrench-closure"].sum() == 3477
""",
    "04_design_a_rig": """
def distance(z):
    metric = tl.workspace.metric("body-distance", bodies=(tl.Body("head", [0.0, 1.55, z], radius=0.12),))
    return tl.sweep(rig, task.target[0], metric)["body-distance"].min()
assert distance(-0.9) < 0.2 < distance(-1.1)
""",
    "05_hardware": """
run_data = exact.to_xarray()
late = [float(abs(run_data.commanded.shift(cycle=k) - run_data.measured).mean()) for k in range(3)]
assert late[1] < 1e-6 < 0.05 < min(late[0], late[2])
slow, fast = (
    tl.compare(rig, each.desired, poses=each.position, solvers=["newton"]).rows[0].step_max
    for each in (exact, run("newton", rate=200.0))
)
assert fast < slow / 2.0
def demand(state):
    force = -20.0 * state.twist[:3]
    return Demand(force * min(1.0, 3.0 / max(np.linalg.norm(force), 1e-9)))
honey = run("newton")
assert 0.8 < np.linalg.norm(honey.desired[-1]) < 1.2  # at 5 cm/s
""",
    "06_validation": """
means = [measure("paper-like", 14, seed=seed).aligned["paper"].score["mean"]["angle"] for seed in (0, 2)]
assert means[1] > 1.3 * means[0]
errors = trials.query("question == 'error'")
assert errors.groupby("choice")["vector"].median().idxmax() == "gain"
worst = np.linalg.norm(result.aligned["paper"].forces - result.desired, axis=1).argmax()
assert result.desired[worst][0] < -1.0
""",
    "07_scenarios": """
half = lift(0.5)
assert half.force[:, 2].min() > 0.58 * rendered.force[:, 2].min()
""",
    "08_mujoco": """
mujoco.mj_resetData(model, data)
mujoco.mj_forward(model, data)
weight = gravity(model, data, "mass")
wrong = around @ tl.allocate(points, -weight, (1.0, 60.0)).tensions + weight
assert 1.4 < np.linalg.norm(wrong) < 2.2
heaviest = {kg: allocate(data, kg / 2.0 * -weight).status for kg in (12, 15)}
assert heaviest == {12: tl.Status.EXACT, 15: tl.Status.NEAREST}
""",
    "09_gradients": """
slope = step(start)[1][3, 1]
difference = (step(start.at[3, 1].add(0.01))[0] - step(start.at[3, 1].add(-0.01))[0]) / 0.02
assert abs(slope - difference) < 0.02 * abs(slope)
def stronger(upper):
    W = structure_matrix(anchors)
    tensions = tensionlab.jax.allocate(W, forces, (0.5, upper))
    return ((forces - jnp.einsum("...nm,...m->...n", W, tensions)) ** 2).sum(axis=-1).mean()
assert jax.grad(stronger)(6.0) < -0.01
held = tl.allocate(structure, [1.0, 0.5, 1.0], rig.limits).tensions
assert tl.allocation_jacobian(structure, [1.0, 0.5, 1.0], rig.limits, reference=held).kink
""",
}  # solutions of the exercises that take no long search or play, and what they find
NEEDS = {"09_gradients": "jax"}  # large libraries that a notebook needs: where one is not installed, it is not run


def load(path: Path) -> Any:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder: notebooks need nothing of the repository, and may write beside themselves."""
    folder = tmp_path / "notebooks"
    folder.mkdir()
    return folder


@pytest.fixture
def shell(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[InteractiveShell]:
    """The shell of a kernel in this process, which has imported already what takes long."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])
    backend = mpl.get_backend()
    with mpl.rc_context(), np.printoptions():
        shell = InteractiveShell.instance(config=Config(HistoryManager={"enabled": False}))
        activate_matplotlib(INLINE)
        configure_inline_support(shell, INLINE)
        select_figure_formats(shell, {"png"})  # which that does for the first shell of a process only
        yield shell
        plt.close("all")
        plt.switch_backend(backend)
    InteractiveShell.clear_instance()


def test_there_are_notebooks() -> None:
    assert "01_allocation" in [path.stem for path in NOTEBOOKS]


@each
def test_stores_little_and_nothing_of_a_machine(path: Path) -> None:
    notebook = load(path)
    nbformat.validate(notebook)
    assert path.stat().st_size < LARGEST
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.execution_count is None, f"cell {cell.id} has an execution count; `make notebooks`"
            words = "".join(
                text for each in shown(cell.outputs) for kind, text in each.items() if kind != "image/png"
            )
            assert not MACHINE.findall(words), f"cell {cell.id} shows what is a machine's; `make notebooks`"


@each
def test_reads_as_the_others_do(path: Path) -> None:
    """A title, what to install, a story, and at the end exercises of two lines, with a hint."""
    notebook = load(path)
    first, last = notebook.cells[0].source, notebook.cells[-1].source
    assert re.match(r"# \S.*\n\n(.|\n)*It needs `pip install \"?tensionlab[^`]* jupyterlab`\.", first)
    assert 2 <= len(EXERCISE.findall(last.partition("## Exercises\n\n")[2])) <= 3
    source = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert [idiom for idiom in NO_IDIOMS if idiom in source] == []


def show(shell: InteractiveShell, result: object, quiet: bool) -> None:
    """Publish the result of a cell, as a kernel does."""
    if result is not None and not quiet:
        data, _ = shell.display_formatter.format(result)
        if data:
            shell.display_pub.publish(data)


@each
def test_runs_and_shows_what_is_stored(path: Path, shell: InteractiveShell) -> None:
    """Warnings are errors here. Pictures have words, for those who do not see them."""
    if library := NEEDS.get(path.stem):
        pytest.importorskip(library)
    for cell in load(path).cells:
        if cell.cell_type == "code":
            with capture_output() as captured:
                shell.display_trap.hook = partial(show, shell, quiet=cell.source.endswith(";"))
                ran = shell.run_cell(cell.source)
            ran.raise_error()
            assert not captured.stderr, f"cell {cell.id} complains: {captured.stderr}"
            pictures = sum("image/png" in output.data for output in captured.outputs)
            words = cell.metadata.get("mystnb", {}).get("image", {}).get("alt", "")
            assert pictures == bool(words), f"cell {cell.id} draws {pictures} figures; it is described: {words!r}"
            printed = [{"stream": captured.stdout}] if captured.stdout else []
            now = lasting_outputs([*printed, *(output.data for output in captured.outputs)])
            assert not (how := differ(cell, now)), f"cell {cell.id}, `make notebooks` stores it: {how}"
    with capture_output():
        solved = shell.run_cell(SOLUTIONS[path.stem])
    solved.raise_error()


def test_what_is_shown_otherwise_is_seen_and_times_are_left_out() -> None:
    stored = load(NOTEBOOKS[0]).cells[1]
    (picture,) = shown(stored.outputs)
    (other,) = shown(load(NOTEBOOKS[-1]).cells[3].outputs)
    assert not differ(stored, [picture])
    assert "pictures" in differ(stored, [other])
    assert differ(stored, [{"stream": "3 N"}])
    stored.outputs = [nbformat.v4.new_output("stream", text="1.00 N at 3 poses")]  # type: ignore[no-untyped-call]
    for text, alike in (("1.01 N at 3 poses", True), ("1.1 N at 3 poses", False), ("1.00 N at 4 poses", False)):
        assert (not differ(stored, [{"stream": text}])) == alike
    head, row = (
        "<tr><th>solver</th><th>call</th><th>gap</th></tr>",
        "<tr><td>newton</td><td>3 µs</td><td>0</td></tr>",
    )
    (lasts,) = lasting_outputs([{"text/html": f"<table>{head}{row}</table>", "text/plain": "<Table>"}])
    assert lasts == {
        "text/html": "<table><tr><th>solver</th><th>gap</th></tr><tr><td>newton</td><td>0</td></tr></table>"
    }


def execute(notebook: Any, folder: Path, tmp_path: Path) -> None:
    """Run a notebook in a kernel of its own: this very interpreter, whatever is installed for the user."""
    kernel = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    client = NotebookClient(notebook, km=kernel, timeout=600, resources={"metadata": {"path": str(folder)}})
    package = str(Path(tensionlab.__file__).parents[1])
    paths = [package, os.environ.get("PYTHONPATH", "")]
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
    client.execute(env=env, cleanup_kc=True)


def test_figures_and_tables_show_once_in_a_kernel_with_or_without_pyplot(folder: Path, tmp_path: Path) -> None:
    sources = [
        "import tensionlab as tl; rig = tl.load_rig('tetra-4'); tl.plot(rig)",
        "rig",
        "%matplotlib inline\nimport matplotlib.pyplot as plt; tl.plot(rig)",
        "figure = plt.figure(); tl.plots.plot_rig(rig, ax=figure.add_subplot(projection='3d'))",
        "with tl.plots.styled():\n    figure, axes = plt.subplots()",
        "with tl.plots.styled():\n    figure, axes = plt.subplots()",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(each) for each in sources])  # type: ignore[no-untyped-call]
    execute(notebook, folder, tmp_path)
    bare, table, inline, panel, *own = ([output.data for output in cell.outputs] for cell in notebook.cells)
    assert [set(each) for each in bare] == [set(each) for each in inline] == [{"text/plain", "image/png"}]
    assert bare[0]["image/png"] == inline[0]["image/png"]
    assert [set(each) for each in table] == [{"text/plain", "text/html"}]
    assert [[set(each) for each in outputs] for outputs in (panel, *own)] == 3 * [[{"text/plain", "image/png"}]]
