"""The notebooks run from top to bottom without an error or a warning, and are committed without outputs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

import tensionlab

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def load(path: Path) -> Any:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


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
def test_runs(path: Path, tmp_path: Path) -> None:
    # What a notebook sees of the repository, somewhere else: it may write beside itself.
    folder = tmp_path / "notebooks"
    folder.mkdir()
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    notebook = load(path)

    # No kernel directories: the kernel is this very interpreter, whatever is installed for the user.
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

    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            assert output.get("name") != "stderr", f"cell {cell.id} complains: {output.text}"
