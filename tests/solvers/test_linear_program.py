"""The linear programs: known answers, HiGHS and cvxpy on the same objectives, and which of equals is taken."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.optimize import linprog

from tensionlab import Status, allocate
from tests.helpers.examples import many
from tests.helpers.problems import cases, one, random_cases, random_structure

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]
EXACT_DIGITS = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}

NAMES = ("least-sum", "minimax", "safe", "safe:0.5", "safe:0")
each_name = pytest.mark.parametrize("name", NAMES)


def alpha_of(name):
    return float(name.partition(":")[2] or 1.0)


def cost(name, t, lower, upper):
    """What the program minimises. Cables without play do not count, but for the sum."""
    moves = lower < upper
    if name == "least-sum":
        return t.sum()
    if not moves.any():
        return 0.0
    t, lower, upper = t[moves], lower[moves], upper[moves]
    if name == "minimax":
        return t.max()
    margin = (t - lower).min()
    return -min(margin, ((upper - t) / alpha_of(name)).min()) if alpha_of(name) else -margin


def least_cost(name, W, w, lower, upper):
    """The same from HiGHS; None where it finds no tensions. Orthonormal rows let it be exact."""
    basis, sigma, rows = np.linalg.svd(W, full_matrices=False)
    kept = sigma > 1e-9 * sigma[0] if sigma[0] else sigma > 0
    rows, values = rows[kept], (basis.T @ w)[kept] / sigma[kept]
    if np.linalg.norm(basis[:, kept] @ (basis.T @ w)[kept] - w) > 1e-9 * max(1.0, np.linalg.norm(w)):
        return None
    m, moves = W.shape[1], np.flatnonzero(lower < upper)
    if name != "least-sum" and not moves.size:
        return 0.0 if np.allclose(rows @ lower, values, atol=1e-9) else None
    gain, extra = np.append(np.ones(m), 0.0), None
    picked = np.eye(m)[moves]
    if name == "minimax":
        gain, extra = np.append(np.zeros(m), 1.0), (np.c_[picked, -np.ones(moves.size)], np.zeros(moves.size))
    elif name != "least-sum":
        alpha = alpha_of(name)
        gain = np.append(np.zeros(m), -1.0)
        rising, falling = np.c_[-picked, np.ones(moves.size)], np.c_[picked, np.full(moves.size, alpha)]
        extra = (np.vstack([rising, falling]), np.append(-lower[moves], upper[moves]))
    bounds = [*zip(lower, upper, strict=True), (None, None) if extra else (0, 0)]
    equal = np.c_[rows, np.zeros(len(rows))]
    found = linprog(gain, *(extra or (None, None)), equal, values, bounds, options=EXACT_DIGITS)
    return found.fun if found.status == 0 else None


# --- Known answers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["least-sum", "minimax", "safe"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_known_answers(case, name):
    lower, upper = np.array(case["fmin"]), np.array(case["fmax"])
    found = allocate(case["W"], case["wrench_to_produce"], (lower, upper), name)
    assert found.status == Status.EXACT
    known = {"least-sum": "min_sum", "minimax": "min_max_tension", "safe": "max_slack_to_bounds"}[name]
    sign = -1 if name == "safe" else 1
    assert sign * cost(name, found.tensions, lower, upper) == pytest.approx(case[known], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "tensions"),
    [
        ("least-sum", (3, 1)),
        ("minimax", (3, 1)),
        ("safe", (4, 2)),  # 1 N from both limits
        ("safe:0.5", (13 / 3, 7 / 3)),  # 4/3 N from the lower limit, half of it from the upper
        ("safe:0", (5, 3)),
    ],
)
def test_two_cables_pull_against_each_other(name, tensions):
    found = allocate([[1, -1]], [2], (1, 5), name)
    assert found.status == Status.EXACT
    np.testing.assert_allclose(found.tensions, tensions, atol=1e-12)


def test_a_narrow_cable_sets_the_margin():
    # 0.5 N is all the margin that the third can have; the other two then stay close to the reference.
    found = allocate([[1, -1, 0]], [0], ([0, 0, 1], [10, 10, 2]), "safe")
    np.testing.assert_allclose(found.tensions, [0.5, 0.5, 1.5], atol=1e-12)
    found = allocate([[1, -1, 0]], [0], ([0, 0, 1], [10, 10, 2]), "safe", [4, 4, 0])
    np.testing.assert_allclose(found.tensions, [4, 4, 1.5], atol=1e-12)


# --- Optimal: against other solvers of the same programs ----------------------------------------------------


@each_name
@pytest.mark.parametrize(
    ("n", "m"), [(2, 1), (2, 2), (2, 5), (3, 3), (3, 4), (3, 8), (3, 12), (6, 7), (6, 8), (6, 12)]
)
def test_random_problems_agree_with_highs(n, m, name):
    count, reached = many(40), 0
    batch = random_cases(100 * n + m, n, m, count)
    found = allocate(batch.structure, batch.wrench, batch.limits, name, batch.reference)
    for i in range(count):
        case = one(batch, i)
        least = least_cost(name, case.structure, case.wrench, case.lower, case.upper)
        out_of_reach = least is None or (name.startswith("safe") and least > 1e-9)
        assert (found.status[i] == Status.EXACT) == (not out_of_reach)
        if not out_of_reach:
            reached += 1
            assert cost(name, found.tensions[i], case.lower, case.upper) == pytest.approx(least, abs=1e-9)
    assert reached >= count / 4


@each_name
def test_awkward_problems_agree_with_highs(name):
    # Fixed, parallel, opposite and absent cables, one cable, any rank, n > m, ties everywhere.
    @settings(max_examples=many(100))
    @given(case=cases())
    def holds(case):
        W, w, lower, upper = case.structure, case.wrench, case.lower, case.upper
        sigma = np.linalg.svd(W, compute_uv=False)
        assume(not np.any((sigma > 1e-9) & (sigma < 1e-3)))  # there a wrench right to 1e-12 leaves the cost loose
        found = allocate(W, w, (lower, upper), name, case.reference)
        closest = allocate(W, w, (lower, upper), "newton", case.reference, "force")
        assert (found.status == Status.EXACT) == (closest.status == Status.EXACT)
        if found.status == Status.EXACT:
            least = least_cost(name, W, w, lower, upper)
            assert cost(name, found.tensions, lower, upper) == pytest.approx(least, abs=1e-8)
        else:
            np.testing.assert_allclose(found.tensions, closest.tensions, rtol=0, atol=1e-7)
        assert found.iterations < 100

    holds()


@each_name
def test_many_equal_cables_make_it_neither_cycle_nor_stray(name):
    # Every cable twice, all entries halves: nearly every step is degenerate.
    rng = np.random.default_rng(4)
    W = rng.integers(-2, 3, (2000, 6, 6)) / 2
    W = np.concatenate([W, W], axis=2)
    wrench = (W @ rng.integers(1, 6, (2000, 12, 1)))[..., 0]
    found = allocate(W, wrench, (1, 5), name)
    assert np.all(found.status == Status.EXACT)
    assert found.iterations.max() < 120  # of the simplex method and of the exact solver that breaks the ties
    assert found.iterations.min() > 0


# --- Which of equals ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["minimax", "safe", "safe:0.5"])
@pytest.mark.parametrize(("n", "m"), [(2, 6), (3, 5), (6, 12)])
def test_of_equally_good_tensions_the_closest_to_the_reference(n, m, name):
    # Limits as tight as the optimum, a hair wider: newton has no better answer inside them.
    count = many(200)
    batch = random_cases(n + m, n, m, count)
    batch.lower[:, 0], batch.upper[:, 0] = 1.0, 1.0 + 0.3 * (name != "minimax")  # a narrow cable makes ties
    batch.lower[:, 1] = np.where(name == "minimax", batch.upper[:, 1] - 0.1, batch.lower[:, 1])
    found = allocate(batch.structure, batch.wrench, batch.limits, name, batch.reference)
    exact = np.flatnonzero(found.status == Status.EXACT)
    assert exact.size > 0.1 * count
    for i in exact:
        case = one(batch, i)
        best = cost(name, found.tensions[i], case.lower, case.upper) + 1e-9
        lower, upper, moves = case.lower, case.upper, case.lower < case.upper
        if name == "minimax":
            upper = np.where(moves, np.minimum(upper, np.maximum(best, lower)), upper)
        else:
            lower = np.where(moves, lower - best, lower)
            upper = np.where(moves, upper + alpha_of(name) * best, upper)
        closest = allocate(case.structure, case.wrench, (lower, upper), "newton", case.reference)
        np.testing.assert_allclose(found.tensions[i], closest.tensions, rtol=0, atol=1e-5)


@pytest.mark.parametrize("n", [2, 3])
def test_of_equal_sums_newton_takes_the_same(n):
    # Cables of a grid have many equal sums. The sum as one more component of the wrench makes it newton's problem.
    rng = np.random.default_rng(n)
    W = rng.integers(-2, 3, (200, n, 7)) / 2
    wrench = (W @ rng.integers(1, 6, (200, 7, 1)))[..., 0]
    reference = rng.uniform(0, 6, (200, 7))
    found = allocate(W, wrench, (1, 5), "least-sum", reference)
    with_sum = np.concatenate([W, np.ones((200, 1, 7))], axis=1)
    desired = np.column_stack([wrench, found.tensions.sum(axis=1)])
    same = allocate(with_sum, desired, (1, 5), "newton", reference)
    np.testing.assert_allclose(found.tensions, same.tensions, rtol=0, atol=1e-6)
    assert np.any(
        np.all((found.tensions > 1.01) & (found.tensions < 4.99), axis=1) | (found.tensions % 1 > 0.01).any()
    )


@each_name
def test_tensions_change_no_faster_than_the_wrench_lets_them(name):
    # Along 1 N in 4,000 steps no tension may jump; a corner of the best tensions would, where they are many.
    rng = np.random.default_rng(0)
    for n, m in ((2, 5), (3, 6)):
        W = random_structure(rng, n, m)
        middle = W @ np.full(m, 3.0)
        wrench = middle + np.linspace(-0.5, 0.5, 4001)[:, None] * rng.normal(size=n)
        found = allocate(W, wrench, (1, 5), name, "lower")
        exact = found.status == Status.EXACT
        assert np.count_nonzero(exact) > 2000
        steps = np.abs(np.diff(found.tensions, axis=0)).max(axis=1)[exact[1:] & exact[:-1]]
        assert steps.max() < 200 * np.linalg.norm(wrench[1] - wrench[0])


@each_name
def test_out_of_reach_it_is_the_closest_wrench_without_a_promise(name):
    batch = random_cases(1, 3, 5, 50)
    far = 5 * batch.wrench + 20
    found, closest = (allocate(batch.structure, far, batch.limits, s, batch.reference) for s in (name, "newton"))
    assert np.all(found.status[closest.status == Status.NEAREST] == Status.UNPROVEN)
    np.testing.assert_allclose(found.tensions, closest.tensions, rtol=0, atol=1e-9)
