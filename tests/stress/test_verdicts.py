"""Verdicts of the exact solver on hostile problems, and that wrong ones would be found."""

import numpy as np
import pytest

from tensionlab.solvers.base import POLICIES, Status
from tensionlab.solvers.least_squares import Newton
from tensionlab.verification import verify
from tests.stress import verdicts
from tests.stress.exact_check import flaw
from tests.stress.hostile_problems import GEOMETRIES, SHAPES, hostile_problems


def test_every_verdict_is_right_and_none_takes_long():
    lines: list[str] = []
    tally = verdicts.check(600, seed=3, report=lines.append)
    assert lines == []
    for policy in POLICIES:
        assert tally[f"{policy} EXACT"] > 150
        assert tally[f"{policy} NEAREST"] > 50
        assert tally[f"{policy} UNPROVEN"] <= 6


def test_no_problem_keeps_a_process_busy_for_ever():
    _, solved, iterations = verdicts.watch(len(SHAPES) * verdicts.BLOCK, seed=1)
    assert solved >= len(SHAPES) * verdicts.BLOCK
    assert iterations <= 2500


def _forever(tell, count, seed):
    while True:
        pass


def test_a_process_that_does_not_end_is_stopped(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(verdicts, "_solve", _forever)
    assert verdicts.watch(1, patience=0.5) == ("", 0, 0)


def test_problems_are_of_every_kind_and_many_can_be_rendered_in_exact_arithmetic():
    problem, inside, kinds = hostile_problems(np.random.default_rng(0), 3, 4, 400)
    assert set(kinds) == set(GEOMETRIES)
    assert ((problem.lower <= inside) & (inside <= problem.upper)).all()
    found = verify(problem, Newton().solve(problem))
    proved = [
        flaw(problem.structure[i], problem.wrench[i], (problem.lower[i], problem.upper[i]), "force",
             (Status.NEAREST, found.tensions[i], found.separation[i], np.nan), inside[i])
        for i in range(400)
    ]  # fmt: skip
    assert sum(each == "NEAREST, and the wrench is feasible" for each in proved) > 80


@pytest.mark.parametrize("policy", POLICIES)
def test_a_verdict_that_is_off_by_little_is_found_out(policy):
    problem, _, _ = hostile_problems(np.random.default_rng(5), 3, 4, 300, policy)
    found = verify(problem, Newton().solve(problem))
    caught = dict.fromkeys(("limits", "exact", "direction", "nearer"), 0)
    for i in range(300):
        W, w, limits = problem.structure[i], problem.wrench[i], (problem.lower[i], problem.upper[i])
        t, d, s = found.tensions[i], found.separation[i], float(found.scale[i])
        beyond = np.nextafter(limits[1], np.inf)
        caught["limits"] += flaw(W, w, limits, policy, (0, beyond, d, s)) == "tensions beyond their limits"
        if found.status[i] == Status.NEAREST:
            caught["exact"] += flaw(W, w, limits, policy, (0, t, d, 1.0)) is not None
            caught["direction"] += flaw(W, w, limits, policy, (1, t, -d, s)) is not None
            poor = limits[0] + 0.5 * (limits[1] - limits[0])
            caught["nearer"] += flaw(W, w, limits, policy, (1, poor, d, s)) is not None
    policy = int((found.status == Status.NEAREST).sum())
    assert caught["limits"] == 300
    assert caught["exact"] == caught["direction"] == policy > 50
    assert caught["nearer"] > 0.5 * policy
