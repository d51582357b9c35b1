"""The notebooks run from top to bottom without an error or a warning, and are committed without outputs."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.core.pylabtools import activate_matplotlib
from IPython.utils.capture import capture_output
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from matplotlib_inline.backend_inline import configure_inline_support
from nbclient import NotebookClient
from traitlets.config import Config

import tensionlab

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
INLINE = "module://matplotlib_inline.backend_inline"
"""The backend with which kernels show figures below their cells."""


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
        yield shell
        plt.close("all")
        plt.switch_backend(backend)
    InteractiveShell.clear_instance()


def test_there_are_notebooks() -> None:
    assert "01_allocation" in [path.stem for path in NOTEBOOKS]


@each
def test_committed_without_outputs(path: Path) -> None:
    notebook = load(path)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs, f"cell {cell.id} has outputs; clear them all before committing"
            assert cell.execution_count is None, f"cell {cell.id} has an execution count; clear all outputs"


@each
def test_runs(path: Path, shell: InteractiveShell) -> None:
    """Warnings are errors here."""
    for cell in load(path).cells:
        if cell.cell_type == "code":
            with capture_output() as captured:
                ran = shell.run_cell(cell.source)
            ran.raise_error()
            assert not captured.stderr, f"cell {cell.id} complains: {captured.stderr}"


def execute(notebook: Any, folder: Path, tmp_path: Path) -> None:
    """Run a notebook in a kernel of its own: this very interpreter, whatever is installed for the user."""
    kernel = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    client = NotebookClient(notebook, km=kernel, timeout=60, resources={"metadata": {"path": str(folder)}})
    package = str(Path(tensionlab.__file__).parents[1])
    paths = [package, os.environ.get("PYTHONPATH", "")]
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
    client.execute(env=env, cleanup_kc=True)


@pytest.mark.realtime  # a kernel in a process of its own
def test_one_runs_in_a_kernel_of_its_own(folder: Path, tmp_path: Path) -> None:
    notebook = load(NOTEBOOKS[0])
    execute(notebook, folder, tmp_path)
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            assert output.get("name") != "stderr", f"cell {cell.id} complains: {output.text}"


@pytest.mark.realtime
def test_figures_and_tables_show_once_in_a_kernel_with_or_without_pyplot(folder: Path, tmp_path: Path) -> None:
    sources = [
        "import tensionlab as tl; rig = tl.load_rig('tetra-4'); rig.plot()",
        "rig",
        "%matplotlib inline\nimport matplotlib.pyplot as plt; rig.plot()",
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
