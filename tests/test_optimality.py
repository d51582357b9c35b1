"""Whether newton is exactly right: random problems, three policies, against the independent judge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings

import tensionlab as tl
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, Answer, Policy, Problem
from tensionlab.verification import verify
from tests.helpers.examples import many
from tests.helpers.oracle import Box, Floats, Truth, UnsureError, along_ray, judge, solve, support
from tests.helpers.problems import Case, cases, one, random_case, random_cases

SHAPES = [
    *((2, m) for m in (2, 3, 4, 6)),
    *((3, m) for m in (2, 3, 4, 5, 6, 7, 8, 12)),
    *((6, m) for m in (4, 6, 7, 8, 9, 10, 11, 12)),
]
COUNT = many(100)  # problems of each shape
PRECISION = 1e-7  # N


def judged(case: Case, policy: Policy) -> Truth | None:
    try:
        return solve(case, policy)
    except UnsureError:
        return None


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize(("n", "m"), SHAPES)
def test_newton_is_exact(n: int, m: int, policy: Policy) -> None:
    batch = random_cases(1000 * n + m, n, m, COUNT)
    if m % 2:  # every other shape weighs all components alike
        batch = replace(batch, weights=np.ones(n))
    found = tl.allocate(
        batch.structure,
        batch.wrench,
        batch.limits,
        reference=batch.reference,
        policy=policy,
        wrench_weights=batch.weights,
    )
    truths = [judged(one(batch, i), policy) for i in range(COUNT)]
    known = np.array([truth is not None for truth in truths])
    assert known.sum() >= 0.98 * COUNT - 1
    sure = [truth for truth in truths if truth is not None]

    assert np.abs(found.tensions[known] - [t.tensions for t in sure]).max() <= PRECISION
    assert np.abs(found.wrench[known] - [t.wrench for t in sure]).max() <= PRECISION
    np.testing.assert_allclose(found.scale[known], [t.scale for t in sure], rtol=0, atol=PRECISION)
    expected = [tl.Status.EXACT if t.reachable else tl.Status.NEAREST for t in sure]
    np.testing.assert_array_equal(found.status[known], expected)


def test_the_problems_are_of_every_kind() -> None:
    # A sample without unreachable wrenches, or without scales between, would prove nothing.
    batch = random_cases(7, 3, 6, COUNT)
    truths = [judged(one(batch, i), "direction") for i in range(COUNT)]
    sure = [t for t in truths if t is not None]
    assert sum(t.reachable for t in sure) > 0.25 * COUNT
    assert sum(0.01 < t.scale < 0.99 for t in sure) > 0.15 * COUNT
    assert sum(np.isnan(t.scale) for t in sure) >= 0.05 * COUNT


def candidates(V: Floats, y: Floats, box: Box) -> Iterator[tuple[Floats, Floats]]:
    """Every pattern of limits: tensions (K, m) in the box, and errors (K, n) of each.

    Free cables take the least-squares solution that is closest to the reference.
    """
    m = V.shape[1]
    for count in range(m + 1):
        bounds = np.array(list(product((0.0, 1.0), repeat=m - count)))
        for subset in combinations(range(m), count):
            free, held = np.array(subset, dtype=int), np.setdiff1d(np.arange(m), subset)
            t = np.tile(box.reference, (len(bounds), 1))
            t[:, held] = np.where(bounds > 0, box.upper[held], box.lower[held])
            if count:
                t[:, free] += (y - t @ V.T) @ np.linalg.pinv(V[:, free], rcond=1e-13).T
            inside = np.clip(t, box.lower, box.upper)
            t = inside[np.all(np.abs(inside - t) <= 1e-12 * box.size, axis=1)]
            if len(t):
                yield t, y - t @ V.T


def nearest_by_patterns(V: Floats, y: Floats, box: Box) -> Floats:
    """Of the t in the box that make |V t - y| least, the one closest to the reference."""
    tensions, errors = (np.concatenate(parts) for parts in zip(*candidates(V, y, box), strict=True))
    best = errors[np.argmin(np.sum(errors**2, axis=1))]
    tied = tensions[np.max(np.abs(errors - best), axis=1, initial=0.0) <= 1e-12 * box.size]
    return np.asarray(tied[np.argmin(np.sum((tied - box.reference) ** 2, axis=1))])


def furthest_by_patterns(W: Floats, w: Floats, box: Box) -> float:
    """Largest s in [0, 1] with ``W t = s w`` in the box."""
    matrix, ray = along_ray(W, w, box)
    best = -np.inf
    for tensions, errors in candidates(matrix, np.zeros_like(w), ray):
        exact = np.max(np.abs(errors), axis=1) <= 1e-12 * box.size
        best = max(best, float(tensions[exact, -1].max(initial=-np.inf)))
    return best / float(ray.upper[-1])


def agree(case: Case, policy: Policy) -> bool:
    """Whether both judges are sure; fails if they are and differ, or if a direction does not separate."""
    try:
        first = judge(case, policy, nearest_by_patterns, furthest_by_patterns)
        second = solve(case, policy)
    except UnsureError:
        return False
    assert first.reachable == second.reachable
    assert np.abs(first.tensions - second.tensions).max() <= 1e-9
    np.testing.assert_allclose(first.scale, second.scale, rtol=0, atol=1e-9)
    for truth in (first, second):
        d = truth.separation
        if not truth.reachable:
            assert d @ case.wrench > support(case.structure, d, case.lower, case.upper)
    return True


@pytest.mark.parametrize("policy", POLICIES)
def test_the_two_judges_agree(policy: Policy) -> None:
    rng = np.random.default_rng(3)
    shapes = [(n, m) for n in (2, 3, 6) for m in range(1, 7) for _ in range(many(10, least=2))]
    sure = sum(agree(random_case(rng, n, m), policy) for n, m in shapes)
    assert sure >= 0.97 * len(shapes) - 1


@settings(max_examples=many(60))
@given(case=cases(largest=6))
def test_the_two_judges_agree_on_awkward_problems(case: Case) -> None:
    for policy in POLICIES:
        agree(case, policy)


def weakly_fixed(case: Case) -> float:
    """How exact can tensions be, N: where W is nearly singular, a wrench right to 1e-12 leaves them loose."""
    sigma = np.linalg.svd(case.structure, compute_uv=False)
    counted = sigma[sigma > RANK_TOLERANCE * sigma[0]]
    condition = counted[0] / counted[-1] if counted.size else 1.0
    return max(PRECISION, 1e-12 * condition * max(1.0, float(np.abs(case.wrench).max())))


@settings(max_examples=many(400))
@given(case=cases())
def test_newton_is_exact_on_awkward_problems(case: Case) -> None:
    # Parallel and absent cables, cables without play, singular and nearly singular matrices, n > m.
    for policy in POLICIES:
        truth = judged(case, policy)
        found = tl.allocate(
            case.structure,
            case.wrench,
            case.limits,
            reference=case.reference,
            policy=policy,
            wrench_weights=case.weights,
        )
        assert found.status in (tl.Status.EXACT, tl.Status.NEAREST)
        if truth is not None:
            assert (found.status == tl.Status.EXACT) == truth.reachable
            assert np.abs(found.wrench - truth.wrench).max() <= PRECISION
            assert np.abs(found.tensions - truth.tensions).max() <= weakly_fixed(case)
            np.testing.assert_allclose(found.scale, truth.scale, rtol=0, atol=PRECISION)


NO_SCALE = {
    "one cable": ([[0.5], [0]], [6.787285170468378, -0.3337511625804755], [0.5], [1.5], [5.65172437932595]),
    "one cable moves": (
        [[0.0, -1.0], [1.0, 0.0]],
        [2.386125368320649, 3.0384917064851438],
        [0.5, 0.0],
        [1.5, 0.0],
        [1.7217432282785579, 5.561814682601849],
    ),
    "in a plane": (
        [[1.0, -0.5], [0.0, 0.0], [-1.0, 1.0]],
        [2.462443254010977, 0.22792353045092917, 0.16120877201551034],
        [1.0, 1.0],
        [6.5, 6.5],
        [5.744953093048526, 0.31017738465347566],
    ),
}


@pytest.mark.parametrize("problem", NO_SCALE.values(), ids=NO_SCALE)
def test_a_direction_that_no_scale_can_keep_is_proved(problem: tuple[list[float], ...]) -> None:
    W, w, lower, upper, reference = map(np.array, problem)
    truth = solve(Case(W, w, lower, upper, reference, np.ones(len(w))), "direction")
    assert np.isnan(truth.scale)
    found = tl.allocate(W, w, (lower, upper), reference=reference, policy="direction")
    np.testing.assert_allclose(found.tensions, truth.tensions, rtol=0, atol=PRECISION)
    assert found.status == tl.Status.NEAREST


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("upper", [1e3, 1e5])
def test_limits_far_beyond_the_wrench_hide_no_proof(upper: float, policy: Policy) -> None:
    # An upper limit may stand for none: a brake, or a cable that never breaks.
    for n, m in ((2, 2), (3, 2), (3, 4), (6, 8)):
        batch = random_cases(100 * n + m, n, m, many(300))
        found = tl.allocate(
            batch.structure, batch.wrench, (batch.lower, upper), reference=batch.reference, policy=policy
        )
        assert np.all(found.status != tl.Status.UNPROVEN), (n, m)


@pytest.mark.parametrize("policy", POLICIES)
def test_however_far_the_wrench_it_is_proved_and_the_answer_is_the_best(policy: Policy) -> None:
    # In the limit the answer is a corner of the available wrench set: one more newton asked for changes nothing.
    batch = random_cases(8, 3, 5, 200)
    for factor in (1e4, 1e8, 1e12):
        found = tl.allocate(batch.structure, factor * batch.wrench, batch.limits, policy=policy)
        further = tl.allocate(batch.structure, 2 * factor * batch.wrench, batch.limits, policy=policy)
        assert np.all(found.status != tl.Status.UNPROVEN)
        if policy == "force" and factor >= 1e8:
            np.testing.assert_allclose(found.wrench, further.wrench, atol=1e-5)


def test_a_wrench_far_out_of_reach_excuses_no_poor_answer() -> None:
    batch = random_cases(8, 3, 5, 20)
    lazy = replace(batch, lower=batch.upper)  # all cables at full tension: hardly ever the best
    found = tl.allocate(lazy.structure, 1e8 * batch.wrench, batch.limits, policy="force")
    answer = Answer(lazy.lower.copy(), np.zeros(20, dtype=np.int64))
    given = Problem(
        batch.structure, 1e8 * batch.wrench, batch.lower, batch.upper, 0 * batch.lower, np.ones(3), "force"
    )
    judged_lazy = verify(given, answer)
    worse = judged_lazy.residual > found.residual + 1e-3
    assert worse.sum() > 10
    assert np.all(judged_lazy.status[worse] == tl.Status.UNPROVEN)
