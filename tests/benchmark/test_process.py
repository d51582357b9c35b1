import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from typing import ClassVar

import numpy as np
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from tensionlab.benchmark import results
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, checksum, problem_set
from tensionlab.benchmark.process import ONE_THREAD, BenchmarkPlan, main, measure, measure_here, plan
from tensionlab.benchmark.results import EVIDENCE, read
from tensionlab.errors import DataError, InputError, TensionlabError, UnknownSolver
from tensionlab.support import provenance


def test_a_run_writes_one_table_with_its_manifest(bench_folder, bench_results):
    assert {path.name for path in bench_folder.iterdir()} == {"results.parquet", "manifest.json"}
    manifest = bench_results.manifest
    assert json.loads((bench_folder / "manifest.json").read_text()) == manifest
    assert manifest["seed"] == 3
    assert manifest["call"] == "tensionlab bench --out 'a folder'"
    assert manifest["versions"]["tensionlab"] == tl.__version__
    assert manifest["processor"]
    assert list(bench_results.sets) == ["point", "unreachable", "trajectory"]
    assert 0 < manifest["bench"]["processor_share"] <= 1.1


def test_every_library_was_told_to_use_one_thread(bench_results):
    assert bench_results.manifest["bench"]["threads"] == ONE_THREAD
    assert set(ONE_THREAD.values()) == {"1"}
    assert {"TENSIONLAB_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} <= set(ONE_THREAD)


def test_each_set_has_a_row_for_each_solver_and_setting(bench_results):
    keys = {(row.problem_set, row.label, row.policy) for row in bench_results.rows}
    assert len(keys) == len(bench_results.rows)
    assert {label for name, label, _ in keys if name == "point"} == {
        "newton", "closed-form", "qp:daqp", "daqp, default", "daqp, tight", "qpsolvers:osqp, default",
        "qpsolvers:osqp, tight", "cvxpy, default", "cvxpy, tight",
    }  # fmt: skip
    assert ("unreachable", "newton", "direction") in keys
    for row in bench_results.of_set("point"):
        assert row.problems == bench_results.sets["point"]["problems"]


def test_the_exact_solver_solves_and_proves_everything(bench_results):
    own = [row for row in bench_results.rows if row.solver == "newton"]
    assert len(own) == 7
    assert all(row.proved == row.tried == row.problems for row in own)
    assert all(row.solved_1e6 == 1.0 for row in own)


def test_the_evidence_adds_up_to_the_summary(bench_results):
    for row in bench_results.rows:
        calls, errors = np.array(row.call_s), np.array(row.errors)
        assert 0 < np.isfinite(calls).sum() <= row.tried
        assert np.nanmax(calls) == row.worst_s
        assert np.isfinite(errors).sum() == row.tried - row.refused - row.failed
        assert np.isnan(row.error_max) == np.isnan(errors).all()
        assert not (errors > row.error_max).any()


def test_results_survive_the_disk_with_and_without_evidence(tmp_path, bench_results):
    results.write(tmp_path / "all.parquet", bench_results.rows, bench_results.manifest)
    results.write(tmp_path / "small.parquet", bench_results.rows, bench_results.manifest, evidence=False)
    again = results.read(tmp_path / "all.parquet")

    def text(rows):
        return repr([vars(row) for row in rows])  # NaN is not equal to itself

    assert text(again.rows) == text(bench_results.rows)
    assert again.manifest == bench_results.manifest
    small = results.read(tmp_path / "small.parquet")
    assert text(small.rows) == text(replace(row, **{key: [] for key in EVIDENCE}) for row in again.rows)
    assert not set(pq.read_schema(tmp_path / "small.parquet").names) & set(EVIDENCE)


def test_what_is_no_result_is_refused_by_name(tmp_path):
    other = tmp_path / "other.parquet"
    provenance.write_parquet(other, [{"solver": "newton"}], provenance.manifest([]))
    for path in (other, tmp_path / "nothing.parquet", tmp_path):
        with pytest.raises(DataError, match="results of `tensionlab bench`"):
            results.read(path)


def test_a_plan_covers_everything_unless_told_otherwise():
    full, quick = plan(), plan(quick=True, count=7, seed=5)
    assert full.sets == tuple(PROBLEM_SETS)
    assert full.solvers is None
    assert (quick.count, quick.seed) == (7, 5)
    assert quick.seconds < full.seconds
    assert plan(["edge", "edge"], ["newton"]) == BenchmarkPlan(("edge",), ("newton",), rounds=0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sets": ["edgy"]}, "'edgy'.*near-singular"),
        ({"sets": []}, "no problem set"),
        ({"solvers": []}, "no solver"),
        ({"seed": -1}, "seed -1"),
    ],
)
def test_a_plan_that_cannot_be_measured_is_refused_before_any_work(wrong, message):
    with pytest.raises(InputError, match=message):
        plan(**wrong)


def test_unknown_solvers_too():
    with pytest.raises(UnknownSolver, match="'newtown'"):
        plan(solvers=["newtown"])


@dataclass(frozen=True)
class Halves:
    """Half the exact tensions, and no answer for 6 cables."""

    objective: ClassVar[str] = "nothing"
    policies: ClassVar[tuple[str, ...]] = ()

    def solve(self, problem):
        exact = tl.solvers.Newton().solve(replace(problem, policy="force"))
        return exact.tensions if problem.lower.shape[1] == 6 else replace(exact, tensions=0.5 * exact.tensions)


def test_a_solver_of_ones_own_is_measured_and_its_mistakes_are_in_the_table(tmp_path):
    what = BenchmarkPlan(("edge",), (Halves(), "newton"), count=12, seconds=0.05, repeats=1, rounds=0)
    found = read(measure(what, tmp_path, [], lambda done: None))
    own, exact = found.rows
    assert (own.label, own.setting, exact.solved_1e6) == ("Halves", "proved", 1.0)
    assert found.manifest["bench"]["plan"]["solvers"] == ["Halves", "newton"]
    assert own.solved_1e6 == 0.0
    np.testing.assert_array_less(0.1, own.error_max)  # half of what is needed renders half of it
    mistake = "the solver returned ndarray; return Answer(tensions, iterations)"
    assert (own.refused, own.note) == (2, f"breaks on some: TypeError: {mistake}")
    assert os.environ.get("TENSIONLAB_NUM_THREADS") is None


def test_a_class_of_a_module_is_measured_in_the_process_of_its_own(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("from tensionlab.solvers import Newton\nclass Mine(Newton):\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    what = BenchmarkPlan(("edge",), ("mine:Mine",), count=6, seconds=0.01, repeats=1, rounds=0)
    found = read(measure(what, tmp_path / "out", [], lambda done: None))
    assert [row.label for row in found.rows] == ["mine:Mine"]
    assert found.manifest["bench"]["threads"] == ONE_THREAD


def test_the_same_problems_have_the_same_checksum():
    sums = [checksum(problem_set("edge", 6, seed)) for seed in (0, 0, 1)]
    assert sums[0] == sums[1] != sums[2]


def test_a_measuring_process_that_breaks_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "false")
    with pytest.raises(TensionlabError, match="status 1"):
        measure(plan(["point"], ["newton"]), tmp_path, [], lambda done: None)


def test_what_backends_print_does_not_disturb_the_progress(tmp_path):
    order = json.dumps({"plan": {"sets": ["point"], "solvers": ["newton"], "count": 5, "seconds": 0.01,
                                 "rounds": 0}, "folder": str(tmp_path), "call": [], "path": []})  # fmt: skip
    script = (
        "import os, sys; from tensionlab.benchmark import process as worker; "
        "old = worker.measure_here; "
        "worker.measure_here = lambda *a: (os.write(1, b'loud\\n'), old(*a))[1]; worker.main()"
    )
    done = subprocess.run([sys.executable, "-c", script, order], capture_output=True, text=True, check=True)
    *shares, last = map(json.loads, done.stdout.splitlines())
    assert shares
    assert all(0 <= line["share"] <= 1 for line in shares)
    assert last == {"folder": str(tmp_path)}
    assert "loud" in done.stderr


def test_results_that_their_folder_does_not_take_are_kept_elsewhere(tmp_path):
    what = BenchmarkPlan(("edge",), ("closed-form",), count=2, seconds=0.01, repeats=1, rounds=0)
    kept = measure_here(what, tmp_path / "gone", [], lambda done: None)
    assert kept != tmp_path / "gone"
    assert results.read(kept).sets.keys() == {"edge"}
    shutil.rmtree(kept)


def test_a_measuring_process_ends_in_silence_where_nobody_hears_it(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    heard = []

    def measure(what, folder, call, progress):
        heard.append(what)
        progress(0.5)

    order = {"plan": asdict(plan(quick=True)), "folder": "new", "call": "bench", "path": []}
    monkeypatch.setattr("tensionlab.benchmark.process.measure_here", measure)
    monkeypatch.setattr("tensionlab.benchmark.process.os.dup", lambda _: writer)
    monkeypatch.setattr("tensionlab.benchmark.process.os.dup2", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["run", json.dumps(order)])
    main()
    assert heard == [plan(quick=True)]
