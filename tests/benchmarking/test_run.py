import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from tensionlab import records
from tensionlab.benchmarking import results
from tensionlab.benchmarking.problem_sets import PROBLEM_SETS
from tensionlab.benchmarking.results import EVIDENCE
from tensionlab.benchmarking.run import ONE_THREAD, Plan, main, measure_here, plan, run
from tensionlab.errors import DataError, InputError, TensionlabError, UnknownSolver


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
    keys = {(row.problem_set, row.label, row.nearest) for row in bench_results.rows}
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
    records.write_parquet(other, [{"solver": "newton"}], records.manifest([]))
    for path in (other, tmp_path / "nothing.parquet", tmp_path):
        with pytest.raises(DataError, match="results of `tensionlab bench`"):
            results.read(path)


def test_a_plan_covers_everything_unless_told_otherwise():
    full, quick = plan(), plan(quick=True, count=7, seed=5)
    assert full.sets == tuple(PROBLEM_SETS)
    assert full.solvers is None
    assert (quick.count, quick.seed) == (7, 5)
    assert quick.seconds < full.seconds
    assert plan(["edge", "edge"], ["newton"]) == Plan(("edge",), ("newton",))


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


def test_a_measuring_process_that_breaks_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "false")
    with pytest.raises(TensionlabError, match="status 1"):
        run(plan(["point"], ["newton"]), tmp_path, [], lambda done: None)


def test_what_backends_print_does_not_disturb_the_progress(tmp_path):
    order = json.dumps({"plan": {"sets": ["point"], "solvers": ["newton"], "count": 5, "seconds": 0.01,
                                 "rounds": 0}, "folder": str(tmp_path), "call": []})  # fmt: skip
    script = (
        "import os, sys; from tensionlab.benchmarking import run as worker; "
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
    what = Plan(("edge",), ("closed-form",), count=2, seconds=0.01, repeats=1, rounds=0)
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

    order = {"plan": asdict(plan(quick=True)), "folder": "new", "call": "bench"}
    monkeypatch.setattr("tensionlab.benchmarking.run.measure_here", measure)
    monkeypatch.setattr("tensionlab.benchmarking.run.os.dup", lambda _: writer)
    monkeypatch.setattr("tensionlab.benchmarking.run.os.dup2", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["run", json.dumps(order)])
    main()
    assert heard == [plan(quick=True)]
