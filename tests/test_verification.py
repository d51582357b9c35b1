"""The compiled judge against a short statement of what it must find, on good, bad and absurd answers."""

from fractions import Fraction

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.solvers.base import GRAZING, RANK_TOLERANCE, TOLERANCE, Answer, Problem
from tensionlab.verification import verify
from tests.helpers.examples import many

LOWER, UPPER = 0.5, 6.0
COUNT = many(100)  # problems for each statement


def problems(n, m, count, policy, stretch, weights):
    rng = np.random.default_rng(100 * n + m)
    structure = rng.normal(size=(count, n, m))
    if n > 2:
        structure[: count // 4, -1] = structure[: count // 4, 0]  # a quarter of them without full rank
    wrench = stretch * np.einsum("bnm,bm->bn", structure, rng.uniform(LOWER, UPPER, size=(count, m)))
    limits = [np.full((count, m), value) for value in (LOWER, UPPER, 0.0)]
    return Problem(structure, wrench, *limits, weights, policy)


def statement(W, w, weights, policy, t, d):
    """Status, residual and scale of tensions t with the proposed direction d, as NumPy would say it."""
    t = np.clip(t, LOWER, UPPER)
    error = w - W @ t
    residual, rendered = (np.sqrt(np.sum(weights * x**2)) for x in (error, W @ t))
    tolerance = TOLERANCE * max(np.sqrt(weights.max()), rendered)

    def reach(d):
        return np.maximum(W.T @ d * LOWER, W.T @ d * UPPER).sum()

    def bounds(d, metric):  # least error in a metric whose dual norm of d is given: weak duality
        return (d @ w - reach(d)) / metric if metric > 0 else -np.inf

    if np.linalg.norm(error) <= TOLERANCE * max(1, np.linalg.norm(w)):
        return tl.Status.EXACT, residual, 1.0
    free = (t > LOWER + 1e-6 * UPPER) & (t < UPPER - 1e-6 * UPPER)
    span = W[:, free] @ np.linalg.pinv(W[:, free], rcond=1e-8)
    force = [d, weights * error - span @ (weights * error), weights * error]
    best_force = max(bounds(x, np.sqrt(np.sum(x**2 / weights))) for x in force)
    if policy == "force" and best_force > 1e-12 and residual - best_force <= tolerance:
        return tl.Status.NEAREST, residual, np.nan
    if policy == "tension":
        inverse = np.linalg.pinv(W, rcond=RANK_TOLERANCE)
        size, outside = np.linalg.norm(inverse @ error), w - W @ inverse @ w
        tolerance = TOLERANCE * max(1, np.linalg.norm(inverse @ W @ t))
        metric = inverse.T @ inverse
        tried = (W @ inverse @ d, metric @ error, metric @ error - span @ metric @ error)
        best = max(bounds(x, np.linalg.norm(W.T @ x)) for x in tried)
        if (size <= tolerance and outside @ w - reach(outside) > 1e-12) or (
            best > 1e-12 and size - best <= tolerance
        ):
            return tl.Status.NEAREST, residual, np.nan
    if policy == "direction" and d @ w - reach(d) > 1e-12:
        # Unit normals; s along <= far, moved outwards by what w may be missed by, less a tenth of it at s = 0.
        length, unit = np.linalg.norm(w), 1 / np.linalg.norm(d)
        allowed = TOLERANCE * max(1, min(length, np.abs(W).sum() * UPPER))
        along, far = d @ w * unit, reach(d) * unit
        if far + 0.9 * allowed < min(0, along - 0.1 * allowed):
            proved = best_force > 1e-12 and residual - best_force <= tolerance
            return (tl.Status.NEAREST if proved else tl.Status.UNPROVEN), residual, np.nan
        share = 0.98 * allowed * np.clip(2 - 2 * along / (GRAZING * length), 0, 1)
        scale = w @ (W @ t) / length**2
        aside, near = np.linalg.norm(W @ t - scale * w), TOLERANCE * max(1, np.linalg.norm(W @ t))
        bound = max(0, (far + 0.9 * share) / (along - 0.1 * share)) if along > 0.1 * share else np.inf
        kept = aside <= (max(near, allowed) if share > 0 else near) and scale * length >= -near
        if kept and (bound - scale) * length <= near + aside * along / length:
            return tl.Status.NEAREST, residual, max(scale, 0.0)
    return tl.Status.UNPROVEN, residual, np.nan


@pytest.mark.parametrize("blur", [0.0, 1e-9, 1e-4, 1.0])
@pytest.mark.parametrize(
    ("policy", "proposed"),
    [("force", True), ("force", False), ("tension", True), ("tension", False), ("direction", True)],
)
@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 3), (3, 8), (6, 8)])
def test_finds_what_its_statement_finds(n, m, policy, proposed, blur):
    weights = np.linspace(0.5, 2.0, n)
    for stretch in (1.0, 1.5):
        problem = problems(n, m, COUNT, policy, stretch, weights)
        answer = tl.solvers.Newton().solve(problem)
        rng = np.random.default_rng(0)
        tensions = answer.tensions + blur * rng.normal(size=answer.tensions.shape)
        proposal = answer.separation if proposed else np.zeros((COUNT, n))
        found = verify(problem, Answer(tensions.copy(), answer.iterations, proposal.copy()))
        for row in range(COUNT):
            status, residual, scale = statement(
                problem.structure[row], problem.wrench[row], weights, policy, tensions[row], proposal[row]
            )
            assert found.status[row] == status, row
            assert found.residual[row] == pytest.approx(residual, rel=1e-9, abs=1e-9)
            np.testing.assert_allclose(found.scale[row], scale, atol=1e-9)


def test_tensions_outside_their_limits_are_clipped_before_they_are_measured():
    problem = problems(3, 4, 1, "force", 1.0, np.ones(3))
    found = verify(problem, Answer(np.array([[-50.0, 3.0, 50.0, 3.0]]), np.zeros(1, dtype=np.int64)))
    np.testing.assert_array_equal(found.tensions, [[LOWER, 3.0, UPPER, 3.0]])
    np.testing.assert_allclose(found.wrench[0], problem.structure[0] @ found.tensions[0])


@pytest.mark.parametrize("strange", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("m", [3, 8, 11])
def test_an_answer_with_a_tension_that_is_no_number_fails_and_nothing_of_it_is_kept(m, strange):
    problem = problems(3, m, m, "force", 1.5, np.ones(3))
    tensions = np.full((m, m), 2.0)
    np.fill_diagonal(tensions, strange)  # each problem with another
    found = verify(problem, Answer(tensions, np.zeros(m, dtype=np.int64), np.ones((m, 3))))
    assert (found.status == tl.Status.FAILED).all()
    for name in ("tensions", "wrench", "residual", "scale"):
        assert np.isnan(getattr(found, name)).all(), name
    assert not found.separation.any()
    assert found.failures == dict.fromkeys(range(m), "the solver returned NaN")


def test_tensions_of_another_shape_are_refused():
    with pytest.raises(tl.errors.ShapeError, match=r"tensions of shape \(2, 3\), not \(2, 4\)"):
        verify(problems(3, 4, 2, "force", 1.0, np.ones(3)), Answer(np.ones((2, 3)), np.zeros(2, dtype=np.int64)))


def judged(structure, wrench, tensions, policy="force", separation=None, weights=None, lower=LOWER, upper=UPPER):
    """What is found of one answer: status, scale, separation."""
    structure = np.atleast_2d(np.asarray(structure, dtype=float))
    n, m = structure.shape
    limits = [np.full((1, m), value) for value in (lower, upper, 0.0)]
    weights = np.ones(n) if weights is None else np.asarray(weights, dtype=float)
    problem = Problem(structure[None], np.asarray([wrench], dtype=float), *limits, weights, policy)
    proposal = None if separation is None else np.asarray([separation], dtype=float)
    found = verify(problem, Answer(np.asarray([tensions], dtype=float), np.zeros(1, dtype=np.int64), proposal))
    return found.status[0], found.scale[0], found.separation[0]


@pytest.mark.parametrize("size", [0.1, 1.0, 1000.0])
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_what_is_missed_by_the_tolerance_of_the_wrench_or_of_a_newton_is_exact(size, share):
    miss = share * TOLERANCE * max(1.0, size)
    status, scale, _ = judged(np.eye(2), [size, 0.0], [size, miss], lower=0.0, upper=1e4)
    assert (status == tl.Status.EXACT) == (share < 1.0)
    assert (scale == 1.0) == (share < 1.0)


@pytest.mark.parametrize("separation", [[np.nan, 1.0], [np.inf, 0.0], None])
def test_a_direction_that_is_no_number_proves_nothing_and_hinders_no_proof(separation):
    status, _, proof = judged(np.eye(2), [9.0, 2.0], [6.0, 2.0], separation=separation)
    assert status == tl.Status.NEAREST
    np.testing.assert_allclose(proof / np.linalg.norm(proof), [1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_what_is_not_proved_comes_without_a_direction(policy):
    status, scale, proof = judged(np.eye(2), [9.0, 2.0], [3.0, 2.0], policy, [1.0, 0.0])
    assert status == tl.Status.UNPROVEN
    assert np.isnan(scale)
    assert not proof.any()


def test_no_wrench_on_the_boundary_is_out_of_reach_by_rounding():
    rng = np.random.default_rng(7)
    for _ in range(200):
        structure, normal = rng.normal(size=(2, 6)), rng.normal(size=2)
        vertex = np.where(normal @ structure > 0.0, UPPER, LOWER)
        tensions = vertex.copy()
        tensions[0] -= np.copysign(30.0 * TOLERANCE * np.linalg.norm(structure @ vertex), vertex[0] - 3.0)
        for policy in ("force", "tension", "direction"):
            status, _, _ = judged(structure, structure @ vertex, tensions, policy, normal)
            assert status == tl.Status.UNPROVEN


def test_what_is_within_reach_is_never_nearest_however_near_by_its_weights():
    """A heavy component makes room for an error of the light one; only that nothing separates them tells."""
    for upper in (2.0, UPPER):  # on the boundary, and inside
        off = [2.0, 2.0 - 30 * TOLERANCE]
        status, _, _ = judged(np.eye(2), [2.0, 2.0], off, separation=[0.0, 1.0], weights=[1e4, 1.0], upper=upper)
        assert status == tl.Status.UNPROVEN


def light_row(m, beyond):
    """An answer to judge: the first cable renders a heavy component, the others a light one, with up to 2 N each.

    Desired is `beyond` more than they can render, and the tensions fall short of that by 30 tolerances, which the
    heavy weight allows. Also what all products in the comparison with the limits amount to.
    """
    structure = np.zeros((2, m))
    structure[0, 0], structure[1, 1:] = 1.0, 1.0
    most = 2.0 * (m - 1)
    tensions = np.full(m, 2.0)
    tensions[1] -= 30 * TOLERANCE
    given = {"separation": [0.0, 1.0], "weights": [1e4, 1.0], "upper": 2.0}
    return (structure, [2.0, most + beyond], tensions), given, 2 * most


@pytest.mark.parametrize("m", [2, 3, 5, 9, 11])
@pytest.mark.parametrize("share", [0.0, 0.8, 1.25])
def test_a_wrench_is_infeasible_by_more_than_the_rounding_of_what_is_compared(m, share):
    """Sums of n and m products of three numbers, each wrong by half an epsilon at most, twice over."""
    _, _, magnitude = light_row(m, 0.0)
    rounding = magnitude * (2 + m + 3) * np.finfo(float).eps
    words, given, _ = light_row(m, share * rounding)
    expected = tl.Status.NEAREST if share > 1.0 else tl.Status.UNPROVEN
    assert judged(*words, **given)[0] == expected


@pytest.mark.parametrize("m", [3, 6, 9, 12])
def test_a_wrench_that_can_be_rendered_in_exact_arithmetic_is_never_infeasible(m):
    rng, wrong = np.random.default_rng(m), 0
    for _ in range(100):
        (structure, wrench, _), given, _ = light_row(m, 0.0)
        row = structure[1, 1:] = rng.normal(size=m - 1)
        upper = rng.uniform(1.0, 3.0)
        tensions = np.append(upper, np.where(row > 0.0, upper, LOWER))
        wrench[0] = upper
        most = sum(Fraction(each) * Fraction(tension) for each, tension in zip(row, tensions[1:], strict=True))
        wrench[1] = float(most)
        if Fraction(wrench[1]) > most:
            wrench[1] = np.nextafter(wrench[1], -np.inf)
        wrong += wrench[1] > sum(row * tensions[1:])  # by rounding
        tensions[1] -= 60 * TOLERANCE / row[0]
        status, _, _ = judged(structure, wrench, tensions, **(given | {"upper": upper}))
        assert status == tl.Status.UNPROVEN
    assert wrong > 0


@pytest.mark.parametrize("beyond", [0.0, 1e-12])
def test_tensions_near_the_best_are_the_nearest_only_where_the_wrench_is_infeasible(beyond):
    """Strong cables: what is missed is much in newtons of the wrench, and little in newtons of tension."""
    tensions = [0.125 - 0.5 * TOLERANCE, 0.0625]
    status, _, _ = judged(
        100.0 * np.eye(2), [12.5 + beyond, 6.25], tensions, "tension", [1.0, 0.0], lower=0.0, upper=0.125
    )
    assert status == (tl.Status.NEAREST if beyond else tl.Status.UNPROVEN)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_nearest_exceeds_the_least_error_by_the_tolerance_at_most(share):
    error = np.sqrt(2.0 * 1000.0 * share * TOLERANCE * np.hypot(6.0, 2.0))  # beside 1000 N that nothing renders
    status, _, _ = judged(np.eye(2), [1006.0, 2.0 + error], [6.0, 2.0], separation=[1.0, 0.0])
    assert status == (tl.Status.NEAREST if share < 1.0 else tl.Status.UNPROVEN)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_heaviest_weight_sets_the_tolerance_where_little_is_rendered(share):
    tensions, weights = [0.0, 6.0 - share * 10.0 * TOLERANCE], [100.0, 1.0]
    status, _, _ = judged(np.eye(2), [0.0, 9.0], tensions, separation=[0.0, 1.0], weights=weights, lower=0.0)
    assert status == (tl.Status.NEAREST if share < 1.0 else tl.Status.UNPROVEN)


def test_what_two_cables_that_pull_alike_miss_hinders_no_proof():
    """Without a proposal: the error less what free cables could still render is the direction."""
    structure = [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    status, _, proof = judged(structure, [9.0, 4.0], [6.0, 2.0, 2.0 - 100 * TOLERANCE])
    assert status == tl.Status.NEAREST
    np.testing.assert_allclose(proof / np.linalg.norm(proof), [1.0, 0.0], atol=1e-12)


def test_no_wrench_on_the_boundary_is_nearest_to_itself():
    """What misses it by 0.9 tolerances along and aside is not exact."""
    wrench = np.array([2.0, 1.0])
    missed = 0.9 * TOLERANCE * np.array([[-2.0, -1.0], [-1.0, 2.0]]).sum(axis=0)
    status, _, _ = judged(np.eye(2), wrench, wrench + missed, "direction", [1.0, 0.0], upper=2.0)
    assert status == tl.Status.UNPROVEN


def test_nothing_of_a_wrench_is_rendered_where_all_that_is_rendered_points_away_from_it():
    for tensions, expected in (([0.5, 0.0], tl.Status.NEAREST), ([1.5, 0.9], tl.Status.UNPROVEN)):
        small = TOLERANCE * np.array(tensions)
        status, scale, _ = judged(np.diag([-1.0, 1.0]), [5.0, 0.0], small, "direction", [1.0, 0.0], lower=0.0)
        assert status == expected
        assert scale == 0.0 or expected == tl.Status.UNPROVEN


@pytest.mark.parametrize(
    ("wrench", "tensions", "lower", "upper"),
    [
        ([0.0, 5.0], [1e-7, 2.0], [1e-7, 0.0], UPPER),  # beside the available wrenches
        ([-5e-4, 1000.0], [0.0, 1.77], 0.0, 500.0),  # out of them, by half the tolerance of so long a wrench
    ],
)
def test_a_wrench_that_grazes_what_is_available_is_rendered_as_far_as_the_tolerance_lets_it(
    wrench, tensions, lower, upper
):
    status, _, _ = judged(np.eye(2), wrench, tensions, "direction", [-1.0, 0.0], lower=lower, upper=upper)
    assert status == tl.Status.UNPROVEN


def test_where_no_share_of_a_wrench_can_be_rendered_the_nearest_wrench_is_proved_not_any():
    for tensions, expected in (([0.5, 0.5], tl.Status.NEAREST), ([3.0, 3.0], tl.Status.UNPROVEN)):
        status, scale, _ = judged([[1.0, 1.0]], [-5.0], tensions, "direction", [-1.0])
        assert status == expected
        assert np.isnan(scale)


def test_what_lies_outside_the_range_of_all_cables_is_proved_and_the_rest_must_be_rendered():
    flat = [[1.0, -1.0], [0.0, 0.0]]
    assert judged(flat, [1.0, 3.0], [2.0, 1.0], "tension")[0] == tl.Status.NEAREST
    assert judged(flat, [1.0, 3.0], [3.0, 1.0], "tension")[0] == tl.Status.UNPROVEN


def test_an_answer_along_a_direction_needs_no_proposal_to_be_proved():
    problem = problems(3, 8, 12, "direction", 1.5, np.ones(3))
    answer = tl.solvers.Newton().solve(problem)
    tensions = answer.tensions.copy()
    tensions[0] = 3.0  # and one that is not the best stays unproved
    found = verify(problem, Answer(tensions, answer.iterations))
    expected = verify(problem, Answer(tensions, answer.iterations, answer.separation))
    assert tl.Status.NEAREST in found.status
    assert found.status[0] == tl.Status.UNPROVEN
    for name in ("status", "scale", "residual"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
@pytest.mark.parametrize("stretch", [1.0, 2.0])
@pytest.mark.parametrize(("n", "m"), [(2, 3), (3, 8), (6, 8), (6, 3)])
def test_one_pass_over_a_batch_one_call_a_problem_and_solver_then_judge_agree(n, m, stretch, policy):
    weights = np.linspace(1.0, 2.0, n)
    problem = problems(n, m, 700, policy, stretch, weights)  # more than the compiled loop takes at a time
    limits = LOWER, UPPER
    apart = verify(problem, tl.solvers.Newton().solve(problem))
    whole = tl.allocate(problem.structure, problem.wrench, limits, policy=policy, wrench_weights=weights)
    allocator = tl.Allocator(limits, policy=policy, wrench_weights=weights)
    singles = [allocator(problem.structure[i], problem.wrench[i]) for i in range(50)]
    for name in ("tensions", "wrench", "residual", "status", "scale", "separation"):
        expected = getattr(apart, name)
        found = [getattr(each, name) for each in singles]
        np.testing.assert_allclose(getattr(whole, name), expected, rtol=1e-10, atol=1e-11, err_msg=name)
        np.testing.assert_allclose(found, expected[:50], rtol=1e-10, atol=1e-11, err_msg=name)


def test_a_single_call_forgets_nothing_and_shares_nothing():
    limits = np.full(8, LOWER), np.full(8, UPPER)
    problem = problems(3, 8, 3, "force", 1.0, np.ones(3))
    allocator = tl.Allocator(limits)
    first, second = (allocator(problem.structure[i], problem.wrench[i]) for i in (1, 2))
    limits[0][:] = 3.0  # the allocator has its own
    again = allocator(problem.structure[1], problem.wrench[1])
    np.testing.assert_array_equal(again.tensions, first.tensions)
    assert not np.shares_memory(first.tensions, second.tensions)
    with pytest.raises(tl.errors.ShapeError, match=r"wrench\[1\] is nan"):
        allocator(problem.structure[1], np.array([0.0, np.nan, 0.0]))
    with pytest.raises(tl.errors.ShapeError, match=r"structure\[0, 2\] is inf"):
        allocator(np.where(np.arange(8) == 2, np.inf, problem.structure[1]), problem.wrench[1])
    with pytest.raises(tl.errors.ShapeError, match="3 rows"):
        allocator(problem.structure[1], np.zeros(2))


@pytest.mark.parametrize("weights", ["one", "others"])
@pytest.mark.parametrize(("n", "m"), [(1, 2), (2, 3), (3, 4), (3, 8), (3, 12), (6, 8), (6, 13)])
def test_what_the_exact_solver_proves_in_passing_is_what_verification_finds(n, m, weights):
    """Many NEAREST answers are verified side by side; each must be as if it had been verified by itself."""
    rng = np.random.default_rng(10 * n + m)
    count = many(2_000)
    structure = rng.normal(size=(count, n, m))
    structure[::7, :, -1] = structure[::7, :, 0]  # cables along one another
    lower = rng.uniform(0.0, 1.0, size=(count, m))
    upper = lower + rng.uniform(0.0, 6.0, size=(count, m)) * (rng.random((count, m)) > 0.1)
    inside = rng.uniform(lower, upper)
    stretch = rng.choice([0.5, 1.0, 1.0 + 1e-9, 1.5, 5.0, 1e4], size=(count, 1))
    wrench = stretch * np.einsum("bnm,bm->bn", structure, inside)
    allocator = tl.Allocator(
        (lower, upper), wrench_weights=np.ones(n) if weights == "one" else rng.uniform(0.3, 3.0, n)
    )
    problem, _ = allocator.problem(structure, wrench)
    expected = verify(problem, tl.solvers.Newton().solve(problem))
    found = allocator(structure, wrench)
    np.testing.assert_array_equal(found.status, expected.status)
    assert (found.status == tl.Status.NEAREST).sum() > count // 10
    np.testing.assert_array_equal(found.iterations > 0, expected.iterations > 0)
    size = 1.0 + np.linalg.norm(expected.wrench, axis=1, keepdims=True)
    np.testing.assert_allclose(found.wrench / size, expected.wrench / size, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.residual / size[:, 0], expected.residual / size[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(found.scale), np.isnan(expected.scale))
    # And the proofs hold: the direction separates, and its bound is the residual.
    for row in np.flatnonzero(found.status == tl.Status.NEAREST):
        direction = found.separation[row]
        along = direction @ structure[row]
        reach = np.maximum(along * lower[row], along * upper[row]).sum()
        bound = (direction @ wrench[row] - reach) / np.sqrt(np.sum(direction**2 / allocator.weights))
        assert bound > 0.0
        assert found.residual[row] - bound <= 2 * TOLERANCE * max(np.sqrt(allocator.weights.max()), size[row, 0])


@pytest.mark.parametrize("scale", [1.0, 1e4, 1e8, 1e9, 1e10])
@pytest.mark.parametrize("policy", tl.solvers.base.POLICIES)
def test_exact_is_true_in_rational_arithmetic_however_large_the_structure(scale, policy):
    """Large columns that nearly cancel: the rounding of ``W t`` comes near to the tolerance, and exceeds it."""
    rng = np.random.default_rng(0)
    structure = scale * rng.normal(size=(COUNT, 3, 8))
    structure[..., -1] = -structure[..., :-1].sum(axis=-1)
    wrench = rng.normal(size=(COUNT, 3))
    found = tl.allocate(structure, wrench, (LOWER, UPPER), policy=policy)
    limits = [np.full((COUNT, 8), value) for value in (LOWER, UPPER, 0.0)]
    answer = Answer(found.tensions.copy(), np.zeros(COUNT, dtype=np.int64))
    again = verify(Problem(structure, wrench, *limits, np.ones(3), policy), answer)
    for W, w, t, *statuses in zip(structure, wrench, found.tensions, found.status, again.status, strict=True):
        error = [
            Fraction(wanted)
            - sum(Fraction(each) * Fraction(tension) for each, tension in zip(row, t, strict=True))
            for row, wanted in zip(W, w, strict=True)
        ]
        allowed = Fraction(TOLERANCE) ** 2 * max(1, sum(Fraction(each) ** 2 for each in w))
        within = sum(each**2 for each in error) <= allowed
        assert [status == tl.Status.EXACT for status in statuses] == [within, within]
