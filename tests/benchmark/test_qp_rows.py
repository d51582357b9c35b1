"""Exported sets run in qpbenchmark, and its solvers agree with the exact solver."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import qpbenchmark
import qpsolvers

import tensionlab as tl
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.cli import main

README = Path(__file__).parents[2] / "datasets" / "problems" / "README.md"
COUNT = 8
SOLVERS = ("daqp", "quadprog")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the exported set `edge`, and the class of the README that reads it."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["problems", "edge", "--count", str(COUNT), "--seed", "3", "--out", "edge.parquet"])
    assert not left.value.code
    (text,) = re.findall(r"^```python\n(.*?)^```$", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    Path("edge.py").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def exported(folder):
    names = {}
    exec(compile((folder / "edge.py").read_text(encoding="utf-8"), "edge.py", "exec"), names)
    return names["Edge"]()


def test_qpbenchmark_runs_two_solvers_on_it(exported):
    results = qpbenchmark.Results("results.csv", exported)
    for solver in SOLVERS:
        qpbenchmark.run(exported, results, only_solver=solver, only_settings="high_accuracy")
    table = results.df
    assert len(table) == len(SOLVERS) * COUNT
    assert table["found"].all()
    for residual in ("primal_residual", "dual_residual", "duality_gap"):
        assert table[residual].max() < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
def test_its_solutions_are_those_of_the_exact_solver(exported, solver):
    problems = iter(exported)
    for group in problem_set("edge", COUNT, 3).groups:
        found = tl.allocate(group.structure, group.wrench, (group.lower, group.upper))
        for tensions in found.tensions:
            solution = qpsolvers.solve_problem(next(problems), solver=solver)
            np.testing.assert_allclose(solution.x, tensions, rtol=0, atol=1e-8)
    assert next(problems, None) is None


@pytest.mark.slow
def test_the_program_of_qpbenchmark_reads_the_class_of_the_readme(folder):
    (words,) = re.findall(r"`qpbenchmark (edge\.py .*?)`", README.read_text(encoding="utf-8"))
    command = [sys.executable, "-m", "qpbenchmark.benchmark", *words.split(), "--author", "nobody"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    settings = 4
    assert len((folder / "edge.csv").read_text().splitlines()) == 1 + settings * COUNT
    assert "daqp" in (folder / "edge.md").read_text()


def test_the_file_says_where_it_came_from(folder):
    manifest = json.loads(pq.read_schema(folder / "edge.parquet").metadata[b"tensionlab"])
    assert (manifest["set"], manifest["reachable"], manifest["seed"]) == ("edge", "all", 3)
    assert manifest["count"] == COUNT
    assert "numpy" in manifest["versions"]
