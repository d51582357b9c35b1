from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks import jacobian as bench
from benchmarks.jacobian import SIZES, TOLERANCE, Agreement, compare, draw, times
from tensionlab.gradients import allocation_jacobian


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_derivatives_of_all_sizes_are_those_of_differences(policy):
    total = sum((compare(draw(n, m, 8, policy, seed=1)) for n, m in SIZES), Agreement())
    assert total.problems == 768
    assert total.compared > 0.8 * total.problems
    assert 0.3 < total.infeasible / total.compared < 0.7
    assert total.largest < TOLERANCE


def test_a_wrong_derivative_is_found(monkeypatch):
    problems = draw(3, 5, 20, "force", seed=0)
    assert compare(problems).largest < TOLERANCE

    def wrong(*given, **rest):
        found = allocation_jacobian(*given, **rest)
        found.__dict__["structure"] = found.structure * (1 + 1e-5)
        return found

    monkeypatch.setattr(bench, "allocation_jacobian", wrong)
    assert compare(problems).largest > 1e-6


def test_problems_at_kinks_are_left_out():
    problems = draw(2, 6, 40, "force", seed=0)
    found = problems.solve()
    held = problems.held(found.tensions)[:, 0].any(axis=1)
    # Tensions that are their own reference: nothing holds those at a limit.
    same = replace(problems, reference=found.tensions[:, 0])
    expected = np.count_nonzero(held & (found.status[:, 0] == tl.Status.EXACT))
    found = compare(same)
    assert found.kinks == expected > 0
    assert found.problems - found.kinks == found.crossed + found.compared


def test_the_derivatives_are_timed_beside_the_solver():
    for feasible in (True, False):
        seconds = times(3, 6, feasible, count=200, rounds=1)
        assert list(seconds) == ["solve", "wrench", "structure", "pull back"]
        assert all(1e-9 < each < 1.0 for each in seconds.values())
