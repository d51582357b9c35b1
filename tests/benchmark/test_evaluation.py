"""The runner, on a set so small that every number can be known."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.entries import entries
from tensionlab.benchmark.evaluation import evaluate_set, no_measurements, summarise
from tensionlab.benchmark.problem_sets import Group, ProblemSet, problem_set
from tensionlab.solvers.base import Answer

BUDGET_S = 10.0
WITHOUT_CLOCK = ("qpsolvers:daqp", "qpsolvers:quadprog", "qpsolvers:highs")
# Two cables that pull together: the best is half each.
SUMS = Group("sums", np.ones((3, 1, 2)), np.array([[4.0], [6.0], [8.0]]), np.zeros(2), np.full(2, 5.0))
LONE = Group("lone", np.ones((2, 1, 1)), np.array([[1.0], [2.0]]), np.zeros((2, 1)), np.full((2, 1), 5.0))
PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])
# Out of reach, with another answer for each policy.
FAR = Group("far", np.stack([PLANAR, PLANAR]), np.array([[12.0, 6.0], [24.0, 12.0]]), np.ones(3), np.full(3, 10.0))


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Time batches of a hundred problems: a large one takes a slow solver all of `BUDGET_S`."""
    monkeypatch.setattr("tensionlab.benchmark.evaluation.BATCH", 100)


def measured(*groups, reachable="all", solvers=None, repeats=2):
    shares = []
    problems = ProblemSet("tiny", "tiny", groups, reachable)
    rng = np.random.default_rng(1)
    found = evaluate_set(problems, entries(reachable, solvers), BUDGET_S, repeats, rng, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    return found._replace(rows=[SimpleNamespace(**row) for row in found.rows])


def enter(monkeypatch, name, answer):
    """A built-in solver that answers a batch with ``answer(problem)``."""

    @dataclass(frozen=True)
    class Entered:
        objective: ClassVar[str] = "least squared change from the reference"
        policies: ClassVar[tuple[str, ...]] = ()

        def solve(self, problem):
            return Answer(answer(problem), np.full(len(problem), 7))

    monkeypatch.setitem(tl.SOLVERS, name, Entered)


def test_every_entry_answers_and_is_timed():
    found = measured(SUMS, LONE)
    assert found.verified["force"] == 5
    for row, table in zip(found.rows, found.measurements, strict=True):
        assert (row.problems, row.tried, row.refused, row.failed) == (5, 5, 0, 0), row
        assert 0 < row.median_s <= row.p99_s <= row.p999_s <= row.worst_s, row
        assert len(table["call_s"]) == len(table["error"]) == len(table["gap"]) == 5
        if row.comparable:
            assert row.solved_1e3 == 1.0, row
            assert row.gap_max < 1e-2, row
        assert np.isfinite(row.build_s) == (row.setting != "proved")
        assert np.isfinite(row.batch_s) == (row.setting == "proved")
        clock = row.setting != "proved" and row.solver not in WITHOUT_CLOCK
        assert (0 < row.own_s < row.sgm_s) if clock else np.isnan(row.own_s), row
    newton = found.rows[0]
    assert (newton.solver, newton.solved_1e9, newton.proved) == ("newton", 1.0, 5)
    assert newton.gap_max < 1e-12


def test_an_error_a_violation_and_a_gap_are_told_apart(monkeypatch):
    def outside(problem):
        low = np.hstack([np.full_like(problem.wrench, -0.1), problem.wrench])
        return np.where(problem.wrench < 7.0, low, [5.1, 3.0])

    # 1 mN too little; outside by 0.1 N, but right when clipped; and right, but not the best.
    enter(monkeypatch, "short", lambda problem: problem.wrench / 2 - [5e-4, 5e-4])
    enter(monkeypatch, "outside", outside)
    enter(monkeypatch, "other", lambda problem: problem.wrench * [1, 0] + [-3.0, 3.0])
    sums = replace(SUMS, wrench=np.array([[4.0], [5.0], [8.0]]))
    short, outside, other = measured(sums, solvers=["short", "outside", "other"]).rows
    assert short.error_max == pytest.approx(1e-3)
    assert (short.solved_1e3, short.solved_1e6, short.violation_max) == (1.0, 0.0, 0.0)
    assert outside.error_max == pytest.approx(0.0, abs=1e-12)
    assert outside.violation_max == pytest.approx(0.1)
    assert (outside.solved_1e3, outside.proved) == (0.0, 3)
    assert (other.solved_1e9, other.violation_max) == (1.0, 0.0)
    assert other.gap_max == pytest.approx(1.0)
    assert other.iterations_max == 7


def test_a_solver_may_refuse_a_shape_and_fail_a_problem(monkeypatch):
    def picky(problem):
        if problem.lower.shape[1] > 1:
            raise ValueError("one cable at most; try another")
        return np.where(problem.wrench > 1.5, np.nan, problem.wrench)

    enter(monkeypatch, "picky", picky)
    found = measured(SUMS, LONE, solvers=["picky"])
    row, calls = found.rows[0], found.measurements[0]["call_s"]
    assert (row.tried, row.refused, row.failed) == (5, 3, 1)
    assert row.note == "refuses some: one cable at most"
    assert row.solved_1e6 == pytest.approx(1 / 5)
    assert np.isnan(calls[:3]).all()
    assert np.isfinite(calls[3:]).all()


@pytest.mark.usefixtures("only_clarabel")
def test_a_baseline_that_is_not_installed_is_a_row_that_says_so():
    rows = measured(SUMS, solvers=["qpsolvers:daqp", "newton"]).rows
    assert [(row.setting, row.note, row.tried) for row in rows] == [
        ("default", "not installed", 0),
        ("tight", "not installed", 0),
        ("proved", "", 3),
    ]


def test_the_least_error_of_an_infeasible_wrench_is_subtracted():
    found = measured(FAR, reachable="none", solvers=["newton", "dykstra", "qp:daqp", "daqp"])
    assert set(found.verified.values()) == {2}
    for row in found.rows:
        if row.setting == "proved":
            assert (row.solved_1e6, row.proved) == (1.0, 2), row
            assert row.gap_max < 1e-6
        else:
            assert (row.solved_1e6, row.proved) == (0.0, 0)


def test_a_slow_entry_sees_some_of_every_group_in_its_time():
    found = evaluate_set(
        problem_set("point", 600, 0),
        entries("all", ["cvxpy:plain", "newton"]),
        budget_s=0.02,
        repeats=1,
        rng=np.random.default_rng(0),
        progress=lambda done: None,
    )
    slow, _, newton = found.rows
    assert 0 < slow["tried"] < newton["tried"]
    assert np.isfinite(found.measurements[0]["call_s"]).sum() == slow["tried"]


def test_times_are_those_of_the_problems_that_were_timed():
    measurements = no_measurements(entries("all", ["daqp"])[0], np.ones(3))
    measurements.values["tried"][:2] = 1.0
    measurements.values["call_s"][:2] = [2e-6, 1e-6]
    measurements.values["build_s"][:2] = [1e-6, 5e-7]
    row = SimpleNamespace(**summarise("a", measurements))
    assert (row.median_s, row.worst_s, row.build_s) == (1e-6, 2e-6, 5e-7)
    assert 4e-7 < row.prebuilt_s < 1.1e-6 < row.sgm_s  # 1 and 0.5 µs, and 2 and 1 µs


def test_the_fastest_call_of_a_problem_counts(monkeypatch):
    found = {repeats: measured(SUMS, solvers=["newton"], repeats=repeats) for repeats in (1, 50)}
    first, fastest = (each.measurements[0]["call_s"] for each in found.values())
    assert fastest.sum() < first.sum()


def test_solved_means_the_wrench_and_the_limits_of_what_was_tried():
    scale = np.array([1.0, 1.0, 1.0, 100.0, 1.0, 1.0])
    measurements = no_measurements(entries("all", ["newton"])[0], scale)
    measurements.values["tried"][:5] = 1.0
    measurements.values["error"][:] = [1e-7, 1e-7, 1e-5, 1e-5, np.nan, np.nan]
    measurements.values["violation"][:] = [0.0, 1e-5, 0.0, 0.0, 0.0, np.nan]
    row = summarise("a", measurements)
    assert (row["problems"], row["tried"], row["failed"]) == (6, 5, 1)
    assert (row["solved_1e3"], row["solved_1e6"], row["solved_1e9"]) == (0.8, 0.4, 0.0)


def test_the_collector_works_again_afterwards():
    import gc

    measured(SUMS, solvers=["newton"])
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
