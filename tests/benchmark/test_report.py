import re
from dataclasses import replace

import numpy as np
import pytest

from tensionlab.benchmark.report import FIGURES, format_newtons, report, table, times
from tensionlab.benchmark.results import EntryResult, Results, summaries
from tensionlab.support.formatting import format_duration, format_share


def row(problem_set="a", solver="newton", setting="proved", policy="force", **values):
    defaults = {"problems": 10, "tried": 10, "solved_1e3": 1.0, "solved_1e6": 1.0, "solved_1e9": 1.0,
                "sgm_s": 1e-5, "median_s": 1e-5, "p999_s": 2e-5, "worst_s": 3e-5, "gap_max": 0.0, "error_max": 0.0,
                "violation_max": 0.0, "objective": "", "comparable": True, "note": ""}  # fmt: skip
    return EntryResult(
        problem_set=problem_set, solver=solver, setting=setting, policy=policy, **(defaults | values)
    )


def made(*rows, **reachable):
    about = {"title": "t", "groups": [["g", 10]], "problems": 10, "verified": {"force": 10}}
    sets = {name: about | {"reachable": kind} for name, kind in reachable.items()}
    return Results(rows, {"bench": {"sets": sets, "batches": [], "calls": []}})


def test_numbers_as_words():
    assert [format_share(share) for share in (0.0, 1.0, 0.9999, 0.00001, 0.5, np.nan)] == [
        "0 %", "100 %", "99.9 %", "0.1 %", "50.0 %", "–",
    ]  # fmt: skip
    assert [format_newtons(value) for value in (0.0, 1e-12, 0.0123, 3.14159, 437.2, 2e9, np.nan)] == [
        "0", "1e-12", "0.012", "3.1", "437", "2e9", "–",
    ]  # fmt: skip
    assert [format_duration(value) for value in (2e-7, 1.5e-6, 2.34e-4, 0.0123, 2.0, np.nan)] == [
        "200 ns", "1.5 µs", "234 µs", "12 ms", "2 s", "–",
    ]  # fmt: skip
    assert [times(value) for value in (1.234, 12.6)] == ["1.2", "13"]
    assert table(["x", "y"], [["1", "2"]]) == "| x | y |\n| :-- | --: |\n| 1 | 2 |"


def test_a_summary_counts_each_set_once_and_only_the_own_policy():
    lines = summaries(
        made(
            row("a", solved_1e6=0.5, sgm_s=1e-5, p999_s=4e-5),
            row("b", sgm_s=4e-5, p999_s=3e-5, gap_max=2.0),
            row("c", solved_1e6=0.25, sgm_s=9.0, iterations_max=9),
            row("c", policy="tension", solved_1e6=0.0),
            a="all", b="all", c="none",
        )
    )  # fmt: skip
    (line,) = lines
    assert (line.label, line.built_in) == ("newton", True)
    assert line.solved_1e6 == pytest.approx(0.75)
    assert line.elsewhere == pytest.approx(0.25)
    assert line.sgm_s == pytest.approx(2e-5)
    assert (line.p999_s, line.gap_max, line.spread) == (4e-5, 2.0, 4.0)
    assert line.iterations_max == 9


def test_summaries_come_fastest_first_and_absent_ones_last():
    gone = row(
        solver="qpsolvers:highs", setting="default", policy=None, note="not installed", tried=0, sgm_s=np.nan
    )
    slow, fast = row(solver="dykstra", sgm_s=1.0), row(solver="newton", sgm_s=1e-6)
    assert [line.label for line in summaries(made(gone, slow, fast, a="all"))] == [
        "newton", "dykstra", "qpsolvers:highs, default",
    ]  # fmt: skip


def test_the_report_says_what_how_and_where(bench_results):
    text = report(bench_results)
    manifest = bench_results.manifest
    for needed in (
        manifest["processor"],
        manifest["platform"],
        "Seed 3",
        "`tensionlab bench --out 'a folder'`",
        "best of 2",
        "0.05 s for each set",
        "instruction set used",
        "## Batches",
        "m = 12",
        "| feasible |",
        "| infeasible |",
        '`qpsolvers.solve_qp(solver="daqp")`',
    ):
        assert needed in text, needed
    for name, version in manifest["versions"].items():
        assert f"{name} {version}" in text
    for name, about in bench_results.sets.items():
        assert f"## {name}\n" in text
        assert about["title"][1:] in text
    for name in FIGURES:
        assert f"figures/{name}.png" in text
    assert "**closed-form** †" in text
    assert "daqp, tight" in text
    assert "nan" not in text.lower()
    assert len({line.count("|") for line in text.splitlines() if line.startswith("| newton")}) <= 1


def test_tables_are_tables(bench_results):
    """Every table has as many cells in each line as in its heading."""
    for block in re.findall(r"(?:^\|.*\n)+", report(bench_results), flags=re.MULTILINE):
        assert len({line.count("|") for line in block.splitlines()}) == 1, block


def test_who_was_missing_or_refused_is_in_the_report(bench_results):
    first = bench_results.rows[0]
    missing = replace(first, solver="qpsolvers:highs", setting="default", note="not installed", tried=0,
                      sgm_s=np.nan, solved_1e6=np.nan)  # fmt: skip
    picky = replace(first, solver="picky", note="refuses some: n + 2 cables at most", refused=7)
    text = report(replace(bench_results, rows=(*bench_results.rows, missing, picky)))
    assert re.search(r"\| qpsolvers:highs, default \| not installed \|", text)
    assert f"- picky: refuses some: n + 2 cables at most (7 of {first.tried} problems)" in text


def test_a_busy_machine_is_admitted(bench_results):
    def with_share(share):
        bench = bench_results.manifest["bench"] | {"processor_share": share}
        return report(replace(bench_results, manifest=bench_results.manifest | {"bench": bench}))

    assert "the machine was busy" in with_share(0.5)
    assert "the machine was busy" not in with_share(0.97)
