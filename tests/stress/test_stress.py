"""A short stress run: every kind of problem is drawn, and a solver that errs is found out."""

import numpy as np
import pytest

from tensionlab.solvers.base import POLICIES, Answer, Verified
from tensionlab.verification import verify
from tests.stress import stress


def test_the_exact_solver_is_never_wrong_and_never_without_proof():
    lines: list[str] = []
    tallies = stress.stress(20_000, seed=5, report=lines.append)
    assert len(lines) == 1 + len(stress.KINDS) * len(POLICIES)
    hard = tallies.pop(("nearly parallel", "direction"))
    assert (hard.wrong, hard.unproved / hard.problems < 0.002) == (0, True), (
        "not all of these are proved, and it says so"
    )
    for (kind, _), tally in tallies.items():
        assert tally.problems == tally.exact + tally.policy > 0
        assert (tally.unproved, tally.wrong) == (0, 0), kind
        assert tally.worst < stress.WRONG
        assert 1 <= tally.quantile(0.5) <= tally.quantile(1.0) < 400
    assert all(tallies["within reach", policy].policy == 0 for policy in POLICIES)
    assert all(tally.exact < 0.01 * tally.problems for (kind, _), tally in tallies.items() if kind == "far beyond")
    assert all(tallies["singular", policy].exact and tallies["singular", policy].policy for policy in POLICIES)


def test_an_answer_that_is_off_by_little_is_found_out(monkeypatch: pytest.MonkeyPatch):
    solve = stress._solve

    def spoilt(problem) -> Verified:
        # Along the null space: the wrench is the same, the tensions are not the closest.
        found = solve(problem)
        null = np.linalg.svd(problem.structure)[2][:, -1]
        tensions = np.clip(found.tensions + 1e-5 * null, problem.lower, problem.upper)
        return verify(problem, Answer(tensions, found.iterations, found.separation.copy()))

    monkeypatch.setattr(stress, "_solve", spoilt)
    monkeypatch.setattr(stress, "SHAPES", ((3, 8),))
    tallies = stress.stress(2_000)
    assert tallies["within reach", "force"].wrong > 0.5 * tallies["within reach", "force"].problems
