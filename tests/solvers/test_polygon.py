"""The polygon of all tensions that render a wrench."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import linprog

import tensionlab as tl
from tensionlab.support.arrays import Floats
from tests.helpers.examples import many
from tests.helpers.problems import Case, exact_tensions, random_cases

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]
GOALS = ("polygon:centroid", "polygon:1-norm", "polygon:2-norm")
SHAPES = [(1, 3), (2, 4), (3, 5), (6, 8), (2, 3), (3, 4), (6, 7), (3, 3), (3, 2)]
every_goal = pytest.mark.parametrize("goal", GOALS)
every_shape = pytest.mark.parametrize(("n", "m"), SHAPES)


# --- Polygons that everybody knows -------------------------------------------------------------------------

KNOWN: dict[str, tuple[list[float], float, list[float], dict[str, list[float]]]] = {
    # weights of t1, t2, t3 in the one component, its value, upper limits, answers; the lower limits are 0
    "rectangle": ([0, 0, 1], 5, [2, 6, 9], {"centroid": [1, 3, 5], "1-norm": [0, 0, 5], "2-norm": [0, 0, 5]}),
    "triangle": ([1, 1, 2], 4, [9, 9, 9], {"centroid": [4 / 3, 4 / 3, 2 / 3], "1-norm": [0, 0, 2]}),
    "all of it has the least sum": ([1, 1, 1], 3, [9, 9, 9], {"1-norm": [1, 1, 1], "2-norm": [1, 1, 1]}),
    "an edge has the least sum": ([1, 2, 2], 4, [9, 9, 9], {"1-norm": [0, 1, 1]}),
    "hexagon": ([1, 1, 1], 3, [2, 2, 2], {"centroid": [1, 1, 1]}),
    "trapezium": ([1, 1, 1], 2, [9, 9, 1], {"centroid": [7 / 9, 7 / 9, 4 / 9]}),
    "a segment": ([1, 1, 1], 4, [0, 3, 2], {"centroid": [0, 2.5, 1.5], "2-norm": [0, 2, 2]}),
    "a point": ([1, 1, 1], 6, [1, 2, 3], {"centroid": [1, 2, 3], "1-norm": [1, 2, 3], "2-norm": [1, 2, 3]}),
}


@pytest.mark.parametrize(
    ("row", "value", "upper", "goal", "answer"),
    [(*known[:3], goal, answer) for known in KNOWN.values() for goal, answer in known[3].items()],
    ids=[f"{name}, {goal}" for name, known in KNOWN.items() for goal in known[3]],
)
def test_polygons_that_everybody_knows(row: Any, value: float, upper: Any, goal: str, answer: Any) -> None:
    found = exact_tensions([row], [value], ([0, 0, 0], upper), f"polygon:{goal}")
    np.testing.assert_allclose(found, answer, rtol=0, atol=1e-12)


@pytest.mark.parametrize("case", [c for c in CASES if len(c["fmin"]) <= len(c["W"]) + 2], ids=lambda c: c["name"])
def test_published_least_sums_and_least_squares(case: dict[str, Any]) -> None:
    W, w, limits = np.array(case["W"]), case["wrench_to_produce"], (case["fmin"], case["fmax"])
    assert W.shape in {(3, 4), (6, 8)}
    least = exact_tensions(W, w, limits, "polygon:1-norm")
    assert least.sum() == pytest.approx(case["min_sum"], rel=1e-9)
    if case["name"] == "spyder_pyramid":  # all of the segment has the least sum: its middle, where it is symmetric
        np.testing.assert_allclose(least, case["min_sum"] / 4, rtol=0, atol=1e-6)
    else:
        np.testing.assert_allclose(least, case["min_sum_t"], rtol=0, atol=1e-6)
    for key, reference in (("min2_from_zero", None), ("min2_from_fmin", "lower"), ("min2_from_mid", "middle")):
        found = exact_tensions(W, w, limits, "polygon:2-norm", reference)
        np.testing.assert_allclose(found, case[key], rtol=0, atol=1e-6)


# --- Against other ways to the same answer -----------------------------------------------------------------


def reachable(n: int, m: int, count: int) -> Case:
    """Random problems that newton solves exactly."""
    batch = random_cases(100 * n + m, n, m, count)
    exact = tl.allocate(batch.structure, batch.wrench, batch.limits).status == tl.Status.EXACT
    assert np.count_nonzero(exact) > count / 3
    parts = (batch.structure, batch.wrench, batch.lower, batch.upper, batch.reference)
    return Case(*(part[exact] for part in parts), weights=np.ones(n))


def corners(case: Case, i: int) -> tuple[Floats, Floats, Floats]:
    """By definition: crossings of two bound lines that keep all limits; a point of the plane, and its basis."""
    W, low, high = case.structure[i], case.lower[i], case.upper[i]
    point, basis = np.linalg.pinv(W) @ case.wrench[i], null_space(W)
    pairs = [(a, b) for b in range(len(low)) for a in range(b)]
    crossings = [
        np.linalg.solve(basis[list(pair)], np.array(values) - point[list(pair)])
        for pair in pairs
        for values in np.stack(np.meshgrid(*([low[k], high[k]] for k in pair)), axis=-1).reshape(4, 2)
    ]
    t = point + np.array(crossings) @ basis.T
    return np.array(crossings)[np.all((t >= low - 1e-9) & (t <= high + 1e-9), axis=1)], point, basis


@pytest.mark.parametrize(("n", "m"), [(1, 3), (2, 4), (3, 5), (6, 8)])
def test_centroid_by_definition(n: int, m: int) -> None:
    batch = reachable(n, m, many(60))
    found = exact_tensions(batch.structure, batch.wrench, batch.limits, "polygon")
    for i, t in enumerate(found):
        p, point, basis = corners(batch, i)
        p = p[np.argsort(np.arctan2(*(p - p.mean(axis=0)).T))]
        q = np.roll(p, -1, axis=0)
        area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        centroid = area @ (p + q) / (3 * area.sum())
        np.testing.assert_allclose(t, point + basis @ centroid, rtol=0, atol=1e-7)


@every_shape
def test_least_sum_is_that_of_a_linear_program(n: int, m: int) -> None:
    batch = reachable(n, m, many(40, least=20))
    found = exact_tensions(batch.structure, batch.wrench, batch.limits, "polygon:1-norm")
    for i, t in enumerate(found):
        limits = np.stack([batch.lower[i], batch.upper[i]], axis=1)
        program = linprog(np.ones(m), A_eq=batch.structure[i], b_eq=batch.wrench[i], bounds=limits)
        if program.status == 0:  # fewer cables than components: HiGHS may not see that the wrench is in range
            assert t.sum() == pytest.approx(program.fun, abs=1e-6)


@every_shape
def test_least_squares_from_any_reference_are_those_of_newton(n: int, m: int) -> None:
    batch = reachable(n, m, many(2000))
    for reference in (0.0 * batch.reference, batch.reference, 10 * batch.reference):
        exact = tl.allocate(batch.structure, batch.wrench, batch.limits, "newton", reference)
        found = exact_tensions(batch.structure, batch.wrench, batch.limits, "polygon:2-norm", reference)
        # Near a singular matrix newton's own tolerance shows.
        clear = np.linalg.cond(batch.structure) < 1e3
        assert clear.mean() > 0.9
        np.testing.assert_allclose(found[clear], exact.tensions[clear], rtol=0, atol=1e-9)


# --- What it does not do ------------------------------------------------------------------------------------


@every_goal
def test_a_rank_too_low_fails_alone_and_says_why(goal: str) -> None:
    W = np.array([np.eye(2, 4), [[1, -1, 1, -1], [2, -2, 2, -2]], np.eye(2, 4)])
    found = tl.allocate(W, [[1, 1], [0, 0], [1, 1]], (0.5, 2.0), goal)
    assert found.status.tolist() == [tl.Status.EXACT, tl.Status.FAILED, tl.Status.EXACT]
    assert np.isnan(found.tensions[1]).all()
    assert "redundancy is 3" in found.failures[1]


def test_too_many_cables_are_refused_before_any_work() -> None:
    message = r"Polygon .* 8 cables for 3 wrench .* redundancy 5.* newton, .*cvxpy"
    with pytest.raises(ValueError, match=message) as e:
        tl.allocate(np.ones((3, 8)), np.zeros(3), (0.0, 1.0), "polygon")
    assert "polygon," not in str(e.value)
