"""What changed between two benchmarks is found, and what only the machine or rounding changed is not."""

import numpy as np
import pandas as pd
import pytest

from tensionlab.benchmark.regressions import find_regressions
from tensionlab.benchmark.results import QUANTITIES, TYPES, Results, write
from tensionlab.errors import InputError

PROBLEMS = 40
NOISE = np.random.default_rng(3).normal(1.0, 0.02, (6, PROBLEMS))


def entry(solver, index, *, seconds=1e-5, error=1e-12, setting="proved", tried=1.0, scale=1.0):
    """Measurements of a solver whose calls take this time, with 2 % of noise."""
    key = {"problem_set": "edge", "solver": solver, "setting": setting, "policy": "", "problem": range(PROBLEMS)}
    values = dict.fromkeys(QUANTITIES, 0.0) | {"tried": tried, "error": error, "scale": scale}
    return pd.DataFrame(key | values | {"call_s": seconds * NOISE[index]})


def made(*entries, checksum="same", busy=1.0):
    """Results of a run with these measurements."""
    sets = {"edge": {"reachable": "all", "problems": PROBLEMS, "checksum": checksum}}
    bench = {"sets": sets, "batches": [], "calls": [], "processor_share": busy}
    manifest = {
        "date": "today",
        "git_commit": None,
        "processor": "one",
        "call": "bench",
        "seed": 0,
        "bench": bench,
    }
    rows = pd.DataFrame({name: pd.Series(dtype=kind) for name, kind in TYPES.items()})
    return Results(rows, manifest, pd.concat(entries) if entries else None)


def baselines(*factors, start=3):
    """Three baselines on a machine that is slower by these factors."""
    names = ("daqp", "cvxpy:plain", "qpsolvers:osqp")
    return [
        entry(name, start + i, seconds=factor * 2e-5, setting="default")
        for i, (name, factor) in enumerate(zip(names, factors, strict=True))
    ]


SAME = baselines(1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("seconds", "others", "verdict"),
    [
        (1.5e-5, SAME, "slower"),
        (5e-6, SAME, "faster"),
        (1.04e-5, SAME, ""),
        (1.5e-5, baselines(1.5, 1.5, 1.5, start=2), ""),
        (2.25e-5, baselines(1.5, 1.5, 1.5, start=2), "slower"),
        (1.3e-5, baselines(1.0, 1.4, 1.0), ""),  # baselines that differ among themselves are the noise
    ],
)
def test_a_time_is_judged_by_what_the_baselines_show_of_the_machine(seconds, others, verdict):
    found = find_regressions(made(entry("newton", 0), *SAME), made(entry("newton", 1, seconds=seconds), *others))
    change = found.changes.iloc[0]
    assert change["verdict"] == verdict
    assert change["regressed"] == (verdict == "slower")
    assert change["ratio_low"] < change["ratio"] < change["ratio_high"]
    assert change["ratio"] * found.drift["edge"] == pytest.approx(seconds / 1e-5, rel=0.03)


def test_on_a_busy_machine_times_are_not_judged_but_accuracy_is():
    new = made(entry("newton", 1, seconds=1e-3), entry("dykstra", 2, error=1e-2), *SAME, busy=0.4)
    found = find_regressions(made(entry("newton", 0), entry("dykstra", 1), *SAME), new)
    assert not found.judged
    assert found.worse[["solver", "verdict"]].values.tolist() == [["dykstra", "less accurate"]]
    assert "the machine was busy" in found.title


def changed(position, value, base=0.9e-9):
    values = np.full(PROBLEMS, base)
    values[position] = value
    return values


@pytest.mark.parametrize(
    ("old", "new", "lost", "gained"),
    [
        ({"error": 0.9e-9}, {"error": changed(7, 2e-6)}, 1, 0),
        ({"error": changed(7, 2e-6)}, {"error": 0.9e-9}, 0, 1),
        ({"error": 0.9e-9}, {"error": 1.1e-9}, 0, 0),  # rounding
        ({}, {"error": changed(slice(3), np.nan)}, 3, 0),  # no answer
        ({}, {"error": changed(slice(3), np.nan), "tried": changed(slice(3), 0.0, 1.0)}, 0, 0),  # not tried
        ({"scale": 1e3}, {"scale": 1e3, "error": 5e-6}, 0, 0),  # accurate for a large wrench
    ],
)
def test_one_lost_problem_is_a_regression_and_rounding_is_none(old, new, lost, gained):
    change = find_regressions(made(entry("newton", 0, **old)), made(entry("newton", 0, **new))).changes.iloc[0]
    assert (change["lost"], change["gained"]) == (lost, gained)
    assert change["verdict"] == ("less accurate" if lost else "more accurate" if gained else "")


@pytest.mark.parametrize(
    ("new", "message"),
    [
        (made(entry("newton", 0), checksum="other"), r"set edge: other problems \(old: seed 0, 40 problems; new"),
        (made(), "no measurements of single problems"),
        (made(entry("dykstra", 0)), "no entry on a problem set in common"),
    ],
)
def test_what_cannot_be_compared_is_refused(new, message):
    with pytest.raises(InputError, match=message):
        find_regressions(made(entry("newton", 0)), new)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_the_command_writes_a_report_and_its_exit_status_tells_regressions(run, tmp_path, factor):
    for name, seconds in (("old", 1e-5), ("new", factor * 1e-5)):
        (tmp_path / name).mkdir()
        write(tmp_path / name, made(entry("newton", 0, seconds=seconds), *SAME))
    path = tmp_path / "report.md"
    code, out, _ = run("regressions", tmp_path / "old", tmp_path / "new", "--out", path)
    assert code == (factor > 1.0)
    assert f"{code} slower" in out
    assert [line.split()[:2] for line in out.splitlines() if line.startswith("edge")] == [
        ["edge", "newton"]
    ] * code
    text = path.read_text()
    assert text.startswith(f"# Regressions of a benchmark\n\n4 rows: 0 less accurate, {code} slower.")
    assert text.count("| edge | newton |") == 1 + code
    code, out, _ = run("regressions", tmp_path / "old", tmp_path / "new", "--json")
    assert f'"regressed": {str(factor > 1.0).lower()}' in out
