"""Results of a benchmark: their summary, report and files."""

import re
import tempfile
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tensionlab.benchmark import results
from tensionlab.benchmark.report import FIGURES, report
from tensionlab.benchmark.results import ID, KEY, QUANTITIES, TYPES, Results
from tensionlab.errors import DataError, InputError, WriteError
from tensionlab.support import provenance


def row(problem_set="a", solver="newton", setting="proved", policy="force", **values):
    """A row of results in which everything was solved."""
    blank = {"str": "", "float": np.nan, "int": 10, "bool": True}
    empty = {name: blank[kind] for name, kind in TYPES.items()}
    times = {"sgm_s": 1e-5, "median_s": 1e-5, "p999_s": 2e-5, "worst_s": 3e-5}
    key = dict(zip(KEY, (problem_set, solver, setting, policy), strict=True))
    return empty | dict.fromkeys(["solved_1e3", "solved_1e6", "solved_1e9"], 1.0) | times | key | values


def made(*rows, **reachable):
    sets = {name: {"reachable": kind} for name, kind in reachable.items()}
    return Results(pd.DataFrame(rows), {"bench": {"sets": sets}})


def test_a_summary_counts_each_set_once_and_only_the_own_policy():
    summary = made(
        row("a", solved_1e6=0.5, sgm_s=1e-5, p999_s=4e-5),
        row("b", sgm_s=4e-5, p999_s=3e-5, gap_max=2.0),
        row("c", solved_1e6=0.25, sgm_s=9.0, iterations_max=19),
        row("c", policy="tension", solved_1e6=0.0),
        a="all", b="all", c="none",
    ).summary()  # fmt: skip
    (line,) = summary.to_dict("records")
    known = {"label": "newton", "solved_1e6": 0.75, "elsewhere": 0.25, "p999_s": 4e-5, "gap_max": 2.0}
    assert {name: line[name] for name in known} == known
    assert line["sgm_s"] == pytest.approx(2e-5)
    assert line["iterations_max"] == 19


def test_summaries_come_fastest_first_and_absent_ones_last():
    gone = row(solver="qpsolvers:highs", setting="default", note="not installed", tried=0, sgm_s=np.nan)
    daqp = [row(solver="daqp", setting=word, sgm_s=time) for word, time in (("default", 3.0), ("tight", 0.5))]
    found = made(gone, row(solver="dykstra", sgm_s=1.0), *daqp, row(solver="newton", sgm_s=1e-6), a="all")
    assert list(found.summary()["label"]) == [
        "newton", "daqp, default", "daqp, tight", "dykstra", "qpsolvers:highs, default",
    ]  # fmt: skip
    assert [line[0] for line in found.table().rows] == ["newton", "daqp, default", "daqp, tight", "dykstra"]
    assert found.table().notes[-1] == "qpsolvers:highs, default: not installed"


def test_the_report_says_what_how_and_where(bench_results):
    text = report(bench_results)
    manifest = bench_results.manifest
    words = ["Seed 3", "`tensionlab bench --out 'a folder'`", "best of 2", "0.3 s for each set", "m = 12",
             "**closed-form** †", "daqp, tight", manifest["processor"], manifest["platform"]]  # fmt: skip
    words += [f"{name} {version}" for name, version in manifest["versions"].items()]
    words += [f"## {name}\n\n{about['title'].capitalize()[:1]}" for name, about in bench_results.sets.items()]
    words += [f"figures/{name}.png" for name in FIGURES]
    assert [word for word in words if word not in text] == []
    assert "nan" not in text.lower()
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        assert len({line.count("|") for line in block.splitlines()}) == 1, block


def test_the_report_says_who_was_missing_or_refused_and_that_the_machine_was_busy(bench_results):
    first = bench_results.rows.iloc[:1]
    missing = first.assign(
        solver="qpsolvers:highs", setting="default", note="not installed", tried=0, sgm_s=np.nan
    )
    picky = first.assign(solver="picky", note="refuses some: n + 2 cables at most", refused=7)
    rows = pd.concat([bench_results.rows, missing, picky])
    bench = bench_results.manifest["bench"]

    def text(share):
        manifest = bench_results.manifest | {"bench": bench | {"processor_share": share}}
        return report(replace(bench_results, rows=rows, manifest=manifest))

    assert "- qpsolvers:highs, default: not installed\n" in text(1.0)
    assert f"- picky: refuses some: n + 2 cables at most (7 of {first['tried'].item()} problems)" in text(1.0)
    assert "the machine was busy" in text(0.5)
    assert "the machine was busy" not in text(0.97)


def test_the_long_table_has_a_row_for_each_problem_and_quantity_of_an_entry(bench_results):
    table = bench_results.to_pandas()
    assert list(table) == [*ID, "quantity", "value"]
    assert not table.duplicated([*ID, "quantity"]).any()
    quantities = set(table["quantity"])
    assert quantities >= {*QUANTITIES}
    largest = table[table["quantity"] == "error"].groupby(KEY)["value"].max()
    error_max = bench_results.rows.set_index(KEY)["error_max"].dropna()
    pd.testing.assert_series_equal(largest.sort_index(), error_max.sort_index(), check_names=False)


def test_results_survive_the_disk_with_and_without_measurements(tmp_path, bench_results):
    results.write(tmp_path, bench_results)
    again, small = results.read(tmp_path), results.read(tmp_path / results.FILE)
    pd.testing.assert_frame_equal(again.rows, bench_results.rows)
    pd.testing.assert_frame_equal(again.measurements, bench_results.measurements)
    pd.testing.assert_frame_equal(small.rows, bench_results.rows)
    assert again.manifest == small.manifest == bench_results.manifest
    with pytest.raises(InputError, match="no measurements of single problems"):
        small.to_pandas()


def test_results_that_cannot_be_written_are_kept_elsewhere(tmp_path, bench_results, monkeypatch):
    (tmp_path / results.FILE).mkdir()
    (tmp_path / "kept").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "kept"))
    with pytest.raises(WriteError, match=r"parquet: is a folder; .*the results are kept in ") as refused:
        results.write(tmp_path, bench_results)
    kept = str(refused.value).rpartition(" in ")[2]
    pd.testing.assert_frame_equal(results.read(kept).measurements, bench_results.measurements)


def test_other_files_are_refused_by_name(tmp_path, bench_results):
    rows, manifest = bench_results.rows.drop(columns="label"), bench_results.manifest
    wrong = {
        "other": ([{"solver": "newton"}], manifest),
        "no-run": (dict(rows.items()), provenance.manifest([])),
        "words": (dict(rows.assign(sgm_s="fast").items()), manifest),
    }
    for name, (table, about) in wrong.items():
        provenance.write_parquet(tmp_path / f"{name}.parquet", table, about)
    for name in (*wrong, "nothing"):
        with pytest.raises(DataError, match=name):
            results.read(tmp_path / f"{name}.parquet")
