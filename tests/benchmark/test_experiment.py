import json
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.experiment import BenchmarkPlan, measure, plan, run
from tensionlab.benchmark.problem_sets import PROBLEM_SETS
from tensionlab.benchmark.results import KEY
from tensionlab.errors import InputError, UnknownSolver
from tensionlab.support.operating_system import ONE_THREAD


def test_a_run_writes_tables_with_their_manifest(bench_folder, bench_results):
    assert {path.name for path in bench_folder.iterdir()} == {
        "results.parquet",
        "measurements.parquet",
        "manifest.json",
    }
    manifest = bench_results.manifest
    assert json.loads((bench_folder / "manifest.json").read_text()) == manifest
    assert (manifest["seed"], manifest["call"]) == (3, "tensionlab bench --out 'a folder'")
    assert manifest["versions"]["tensionlab"] == tl.__version__
    assert list(bench_results.sets) == ["point", "unreachable", "trajectory"]
    assert 0 < manifest["bench"]["processor_share"] <= 1.1


def test_the_verb_measures_with_one_thread_for_every_library(tmp_path):
    words = ["bench", "--quick", "--set", "published", "--solvers", "newton", "--count", "1", "--out", "new"]
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    command = [sys.executable, "-m", "tensionlab", *words]
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    manifest = json.loads((tmp_path / "new" / "manifest.json").read_text())
    assert manifest["bench"]["threads"] == dict.fromkeys(ONE_THREAD, "1")
    assert {"TENSIONLAB_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} <= set(ONE_THREAD)


def test_each_set_has_a_row_for_each_solver_setting_and_policy(bench_results):
    rows = bench_results.rows
    assert not rows.duplicated(KEY).any()
    assert set(rows.loc[rows["problem_set"] == "point", "label"]) == {
        "newton", "closed-form", "qp:daqp", "daqp, default", "daqp, tight", "qpsolvers:osqp, default",
        "qpsolvers:osqp, tight", "cvxpy, default", "cvxpy, tight",
    }  # fmt: skip
    newton = rows[rows["solver"] == "newton"]
    assert list(newton["policy"]) == ["force"] + 2 * ["force", "tension", "direction"]
    assert (newton["proved"] == newton["problems"]).all()
    assert (newton["tried"] == newton["problems"]).all()
    assert (newton["solved_1e6"] == 1.0).all()


def test_the_measurements_add_up_to_the_rows(bench_results):
    rows, by_entry = bench_results.rows.set_index(KEY), bench_results.measurements.groupby(KEY, sort=False)
    errors = by_entry["error"]
    assert (by_entry.size() == rows["problems"]).all()
    assert (by_entry["call_s"].max() == rows["worst_s"]).all()
    assert (errors.count() == rows["tried"] - rows["refused"] - rows["failed"]).all()
    np.testing.assert_array_equal(errors.max(), rows["error_max"])


def test_a_plan_covers_everything_unless_told_otherwise():
    full, quick = plan(), plan(quick=True, count=7, seed=5)
    assert full.sets == tuple(PROBLEM_SETS)
    assert full.solvers is None
    assert (quick.count, quick.seed) == (7, 5)
    assert quick.seconds < full.seconds
    assert plan(count=1).count == 1
    assert plan(["edge", "edge"], ["newton"]) == BenchmarkPlan(("edge",), ("newton",))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sets": ["edgy"]}, "'edgy'.*near-singular"),
        ({"sets": []}, "no problem set"),
        ({"solvers": []}, "no solver"),
        ({"seed": -1}, "seed -1"),
        ({"count": 0}, "count 0 must be 1 or more"),
        ({"count": 0, "quick": True}, "count 0 must be 1 or more"),
        ({"solvers": ["newtown"]}, "'newtown'"),
    ],
)
def test_a_plan_that_cannot_be_measured_is_refused_before_any_work(wrong, message):
    with pytest.raises((InputError, UnknownSolver), match=message):
        plan(**wrong)


@dataclass(frozen=True)
class Halves:
    """Half the exact tensions, and no answer for 6 cables."""

    objective: ClassVar[str] = "nothing"
    policies: ClassVar[tuple[str, ...]] = ()

    def solve(self, problem):
        exact = tl.solvers.Newton().solve(replace(problem, policy="force"))
        return exact.tensions if problem.lower.shape[1] == 6 else replace(exact, tensions=0.5 * exact.tensions)


def test_a_solver_of_ones_own_is_measured_and_its_mistakes_are_in_the_table():
    what = BenchmarkPlan(("edge",), (Halves(), "newton"), count=12, seconds=0.05, repeats=1)
    found = measure(what, None, [], lambda done: None)
    _, own = next(found.rows[:1].iterrows())
    assert list(found.rows["label"]) == ["Halves", "newton"]
    assert list(found.rows["solved_1e6"]) == [0.0, 1.0]
    assert found.manifest["bench"]["plan"]["solvers"] == ["Halves", "newton"]
    np.testing.assert_array_less(0.1, own.error_max)  # half of what is needed renders half of it
    mistake = "the solver returned ndarray; return Answer(tensions, iterations)"
    assert (own.failed, own.note) == (2, f"breaks on some: TypeError: {mistake}")
    assert os.environ.get("TENSIONLAB_NUM_THREADS") is None


def test_results_are_written_where_a_folder_is_named(tmp_path):
    found = run(["newton"], ["edge"], out=tmp_path / "bench", count=1, quick=True)
    assert (tmp_path / "bench" / "manifest.json").exists()
    assert run(["newton"], ["edge"], count=1, quick=True).rows.shape == found.rows.shape


def test_what_backends_print_is_no_result(capfd):
    class Loud(Halves):
        def solve(self, problem):
            os.write(1, b"loud")
            return super().solve(problem)

    measure(BenchmarkPlan(("edge",), (Loud(),), count=6, seconds=0.01, repeats=1), None, [], lambda done: None)
    out, err = capfd.readouterr()
    assert not out
    assert "loud" in err
