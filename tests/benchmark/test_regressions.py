"""What changed between two benchmarks is found, and what only the machine or rounding changed is not."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.benchmark.regressions import find_regressions
from tensionlab.benchmark.results import EntryResult, Results, write
from tensionlab.errors import InputError

PROBLEMS = 40
NOISE = np.random.default_rng(3).normal(1.0, 0.02, (6, PROBLEMS))


def row(solver, index, *, seconds=1e-5, errors=1e-12, setting="proved", problem_set="edge", **more):
    """A solver whose calls take so long, with 2 % of noise."""
    defaults = {"policy": None, "objective": "", "comparable": True, "note": "", "problems": PROBLEMS}
    evidence = {
        "tried": PROBLEMS,
        "call_s": (seconds * NOISE[index]).tolist(),
        "errors": np.broadcast_to(errors, PROBLEMS).tolist(),
        "violations": [0.0] * PROBLEMS,
        "scales": [1.0] * PROBLEMS,
    }
    return EntryResult(problem_set, solver, setting, **(defaults | evidence | more))


def run(*rows, checksum="same", busy=1.0):
    """Results of a run with these rows, and three baselines."""
    sets = {"edge": {"title": "t", "groups": [], "problems": PROBLEMS, "verified": {}, "checksum": checksum}}
    bench = {"sets": sets, "batches": [], "calls": [], "processor_share": busy, "plan": {"count": PROBLEMS}}
    manifest = {
        "date": "today",
        "git_commit": None,
        "processor": "one",
        "call": "bench",
        "seed": 0,
        "bench": bench,
    }
    return Results(rows, manifest)


def baselines(factor, start=3):
    """Three baselines on a machine that is slower by a factor."""
    names = ("daqp", "cvxpy:plain", "qpsolvers:osqp")
    return [row(name, start + i, seconds=factor * 2e-5, setting="default") for i, name in enumerate(names)]


def test_a_slower_solver_is_found_on_a_slower_machine():
    old = run(row("newton", 0), row("dykstra", 1), *baselines(1.0))
    new = run(row("newton", 1, seconds=1.5e-5), row("dykstra", 2, seconds=1.5e-5 * 1.5), *baselines(1.5, 2))
    found = find_regressions(old, new)
    assert found.drift["edge"] == pytest.approx(1.5, rel=0.05)
    assert [change.solver for change in found.found] == ["dykstra"]
    (change,) = found.found
    assert change.ratio == pytest.approx(1.5, rel=0.05)
    assert change.ratio_low < change.ratio < change.ratio_high
    assert change.verdict == "slower"


def test_a_faster_one_is_no_regression():
    found = find_regressions(
        run(row("newton", 0), *baselines(1.0)), run(row("newton", 1, seconds=5e-6), *baselines(1.0))
    )
    assert found.changes[0].verdict == "faster"
    assert found.found == []


def test_noise_is_no_regression():
    found = find_regressions(
        run(row("newton", 0), *baselines(1.0)), run(row("newton", 1, seconds=1.04e-5), *baselines(1.0))
    )
    assert [change.verdict for change in found.changes] == [""] * 4


def test_baselines_that_differ_among_themselves_are_the_noise():
    apart = [replace(each, call_s=[factor * s for s in each.call_s]) for factor, each in
             zip((1.0, 1.4, 1.0), baselines(1.0), strict=True)]  # fmt: skip
    found = find_regressions(run(row("newton", 0), *baselines(1.0)), run(row("newton", 1, seconds=1.3e-5), *apart))
    assert not any(change.slower for change in found.changes)


def test_on_a_busy_machine_times_are_not_judged_but_accuracy_is():
    new = run(row("newton", 1, seconds=1e-3), row("dykstra", 2, errors=1e-2), *baselines(1.0), busy=0.4)
    found = find_regressions(run(row("newton", 0), row("dykstra", 1), *baselines(1.0)), new)
    assert not found.judged
    assert [(change.solver, change.verdict) for change in found.found] == [("dykstra", "less accurate")]
    assert "the machine was busy" in found.title


def test_one_lost_problem_is_a_regression_and_rounding_is_none():
    errors = np.full(PROBLEMS, 0.9e-9)
    lost = errors.copy()
    lost[7] = 2e-6
    rounded = np.full(PROBLEMS, 1.1e-9)
    old = run(row("newton", 0, errors=errors), row("dykstra", 1, errors=errors))
    found = find_regressions(old, run(row("newton", 0, errors=lost), row("dykstra", 1, errors=rounded)))
    assert [(change.lost, change.gained, change.verdict) for change in found.changes] == [
        (1, 0, "less accurate"),
        (0, 0, ""),
    ]
    assert [change.verdict for change in find_regressions(run(row("newton", 0, errors=lost)), old).changes] == [
        "more accurate"
    ]


def test_no_answer_counts_as_lost_but_what_was_not_tried_does_not():
    errors = np.full(PROBLEMS, 1e-12)
    errors[:3] = np.nan
    old = run(row("newton", 0))
    assert find_regressions(old, run(row("newton", 0, errors=errors))).changes[0].lost == 3
    assert find_regressions(old, run(row("newton", 0, errors=errors, tried=PROBLEMS - 3))).changes[0].lost == 0


def test_the_accuracy_is_that_of_large_wrenches_where_they_are_large():
    large = {"scales": [1e3] * PROBLEMS}
    found = find_regressions(run(row("newton", 0, **large)), run(row("newton", 0, errors=5e-6, **large)))
    assert found.changes[0].lost == 0


@pytest.mark.parametrize(
    ("new", "message"),
    [
        (run(row("newton", 0), checksum="other"), r"set edge: other problems \(old: seed 0, 40 problems; new"),
        (run(row("newton", 0, scales=[])), "the new results have no evidence for single problems"),
        (run(row("dykstra", 0)), "no entry on a problem set in common"),
    ],
)
def test_what_cannot_be_compared_is_refused(new, message):
    with pytest.raises(InputError, match=message):
        find_regressions(run(row("newton", 0)), new)


def test_the_report_names_what_regressed_and_both_runs():
    found = find_regressions(
        run(row("newton", 0), *baselines(1.0)), run(row("newton", 1, seconds=2e-5), *baselines(1.0))
    )
    text = found.report()
    assert text.startswith("# Regressions of a benchmark\n\n4 rows: 0 less accurate, 1 slower.")
    assert text.count("| edge | newton |") == 2
    assert "no commit" in text
    assert "**the processors differ**" not in text
    assert "newton" in found._repr_html_()
    assert list(found.to_pandas()["verdict"]) == ["slower", "", "", ""]


def test_the_command_says_what_became_worse_and_ends_with_1(run_command, tmp_path):
    code, out, _ = run_command(row("newton", 1, seconds=2e-5), "--out", tmp_path / "report.md")
    assert code == 1
    assert "1 slower" in out
    assert [line.split()[:2] for line in out.splitlines() if "newton" in line] == [["edge", "newton"]]
    assert "daqp" not in out  # nothing changed there
    assert (tmp_path / "report.md").read_text().startswith("# Regressions")


def test_the_command_ends_with_0_where_nothing_became_worse(run_command):
    code, out, _ = run_command(row("newton", 1), "--json")
    assert code == 0
    assert '"regressed": false' in out


@pytest.fixture
def run_command(run, tmp_path):
    """Run `tensionlab regressions` on an old run and one with this row in place of newton's."""

    def call(new, *words):
        for name, first in (("old", row("newton", 0)), ("new", new)):
            found = globals()["run"](first, *baselines(1.0))
            write(tmp_path / f"{name}.parquet", found.rows, found.manifest)
        return run("regressions", tmp_path / "old.parquet", tmp_path / "new.parquet", *words)

    return call
