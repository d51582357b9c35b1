"""The benchmark's table is of the committed results, and these are of the solvers and sets that there are."""

import sys
from pathlib import Path

import pytest

import tensionlab
from tensionlab.benchmark import results
from tensionlab.benchmark.entries import entries
from tensionlab.benchmark.problem_sets import PROBLEM_SETS
from tensionlab.benchmark.results import KEY
from tools import generate_benchmark_table
from tools.generate_benchmark_table import COMMITTED, headline, main, section

ROOT = Path(__file__).parents[2]


def test_the_committed_results_are_small_and_whole():
    committed = results.read(ROOT / COMMITTED)
    assert (ROOT / COMMITTED / results.FILE).stat().st_size < 200_000
    assert {"newton", "daqp"} <= set(committed.rows["solver"])


def test_the_committed_results_are_of_the_solvers_and_sets_that_there_are():
    committed = results.read(ROOT / COMMITTED)
    assert list(committed.sets) == list(PROBLEM_SETS), "run `make bench-readme` on an idle machine"
    for name, about in committed.sets.items():
        rows = committed.rows[committed.rows["problem_set"] == name]
        expected = [[*entry.key(name).values()] for entry in entries(about["reachable"])]
        assert sorted(rows[KEY].values.tolist()) == sorted(expected), "run `make bench-readme` on an idle machine"


def test_the_table_says_what_was_measured_on_what_and_when(bench_results):
    text, about = section(bench_results), bench_results.manifest
    assert f"on one thread of {about['processor']}" in text
    assert f"{about['date'][:10]}, tensionlab {tensionlab.__version__}" in text
    assert all(label in text for label in bench_results.summary()["label"])


def test_a_run_before_a_change_of_the_solvers_says_so(bench_results, monkeypatch):
    bench_results.manifest["bench"]["sources"] = generate_benchmark_table.sources()
    assert not any("have changed since" in make(bench_results) for make in (section, headline))
    monkeypatch.setattr(generate_benchmark_table, "TIMED", ("tensionlab/allocation.py",))
    assert all("have changed since" in make(bench_results) for make in (section, headline))


def test_other_results_make_another_table(bench_results):
    assert section(bench_results) != section(results.read(ROOT / COMMITTED))


def test_one_command_takes_a_run_into_the_repository(tmp_path, monkeypatch, capsys, bench_folder, bench_results):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["generate_benchmark_table", str(bench_folder)])
    main()
    assert (tmp_path / COMMITTED / "manifest.json").exists()
    assert section(results.read(tmp_path / COMMITTED)) == section(bench_results)
    for words, message in (((), "name the folder of a run"), (("nowhere",), "results of `tensionlab bench`")):
        monkeypatch.setattr(sys, "argv", ["generate_benchmark_table", *words])
        with pytest.raises(SystemExit, match="2"):
            main()
        assert message in capsys.readouterr().err
