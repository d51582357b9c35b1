"""Program solvers: what every backend must answer, and bases that respect the rank of the structure matrix."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.solvers.base import GRAZING, RANK_TOLERANCE, TOLERANCE
from tensionlab.solvers.programs import Ray, independent_rows, times, whitener
from tensionlab.solvers.quadratic import QuadraticProgram, installed_backends

each_solver = pytest.mark.parametrize(
    "solver", ["newton", "cvxpy", *(f"qp:{backend}" for backend in installed_backends())]
)
each_policy = pytest.mark.parametrize("policy", QuadraticProgram.policies)


def structures(rank):
    """Twenty random 3 x 5 structure matrices of a rank."""
    rng = np.random.default_rng(rank)
    return rng.normal(size=(20, 3, rank)) @ rng.normal(size=(20, rank, 5))


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_whitened_error_is_the_distance_to_equilibrium(rank):
    W = structures(rank)
    error = np.random.default_rng(9).normal(size=(20, 3))
    distance = np.linalg.norm(times(np.linalg.pinv(W, rcond=RANK_TOLERANCE), error), axis=1)
    np.testing.assert_allclose(np.linalg.norm(times(whitener(W), error), axis=1), distance, atol=1e-9)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_independent_rows_are_as_many_as_the_rank_and_span_the_rows(rank):
    for W in structures(rank):
        basis, strength = independent_rows(W)
        rows = basis.T @ W
        assert rows.shape == (rank, 5)
        np.testing.assert_allclose(rows @ rows.T, np.diag(strength**2), atol=1e-12)
        np.testing.assert_allclose(basis @ rows, W, atol=1e-12)


@pytest.mark.parametrize(("share", "counts"), [(0.1 * RANK_TOLERANCE, False), (10 * RANK_TOLERANCE, True)])
def test_all_agree_on_what_counts_as_zero(share, counts):
    W = np.diag([2.0, 2.0 * share])
    assert (whitener(W)[1, 1] > 0) == counts
    assert len(independent_rows(W)[1]) == 1 + counts


@each_solver
@pytest.mark.parametrize(
    ("policy", "tensions", "scale"),
    [("tension", (10, 575 / 122, 1), np.nan), ("force", (10, 3.88, 1), np.nan), ("direction", (10, 5, 1), 8 / 15)],
)
def test_out_of_reach_each_policy_gives_its_own_answer(solver, policy, tensions, scale):
    result = tl.allocate([[1, -0.6, -0.6], [0, 0.8, -0.8]], [12, 6], (1, 10), solver, policy=policy)
    assert result.status == tl.Status.NEAREST
    np.testing.assert_allclose(result.tensions, tensions, atol=1e-7)
    np.testing.assert_allclose(result.scale, scale, atol=1e-8)


@each_solver
def test_weights_say_which_component_matters(solver):
    # One cable pulls both components alike: q1 (2 - t)² + q2 t² is least at t = 2 q1 / (q1 + q2).
    result = tl.allocate([[1], [1]], [2, 0], (0, 5), solver, policy="force", wrench_weights=[3, 1])
    np.testing.assert_allclose(result.tensions, [1.5], atol=1e-7)
    assert result.status == tl.Status.NEAREST


@each_solver
@pytest.mark.parametrize(("policy", "wrench"), [("force", (4, 9)), ("tension", (4, 9)), ("direction", (8, 10))])
def test_of_equally_good_tensions_the_closest_to_the_reference(solver, policy, wrench):
    # The first two cables render the same, the last one always pulls with 1 N; the third one can do no more.
    limits = ([0, 0, 0, 1], [5, 5, 5, 1])
    result = tl.allocate([[1, 1, 0, 2], [0, 0, 1, 0]], wrench, limits, solver, [3, 2, 0, 0], policy)
    np.testing.assert_allclose(result.tensions, [1.5, 0.5, 5, 1], atol=1e-6)
    assert result.status == tl.Status.NEAREST


@each_solver
@each_policy
def test_rank_deficient_rigs_are_ordinary(solver, policy):
    # Two opposite cables on a line: what lies on it is rendered, what lies across is not.
    result = tl.allocate([[1, -1], [1, -1]], [[2, 2], [2, 0]], (1, 5), solver, policy=policy)
    assert result.status.tolist() == [tl.Status.EXACT, tl.Status.NEAREST]
    np.testing.assert_allclose(result.tensions, [[3, 1], [1, 1] if policy == "direction" else [2, 1]], atol=1e-6)


@each_solver
@each_policy
@pytest.mark.parametrize("fixed", [0, 1, 2])
def test_answers_are_those_of_the_exact_solver(solver, policy, fixed):
    """Some cables have equal limits: they keep their tensions, and the others render the rest of the wrench."""
    rng = np.random.default_rng(11)
    for n, m in [(2, 3), (3, 8), (6, 8)]:
        W = rng.normal(size=(n, m + fixed))
        lower = np.append(np.full(m, 0.5), [2.0, 1.0][:fixed])
        upper = np.append(np.full(m, 6.0), lower[m:])
        wrenches = np.concatenate([rng.uniform(lower, upper, (4, m + fixed)) @ W.T, 8 * rng.normal(size=(4, n))])
        found = tl.allocate(W, wrenches, (lower, upper), solver, policy=policy)
        exact = tl.allocate(W, wrenches, (lower, upper), policy=policy)
        np.testing.assert_array_equal(found.status, exact.status)
        np.testing.assert_allclose(found.tensions, exact.tensions, rtol=0, atol=1e-5)
    fixed_alone = tl.allocate([[1, 1]], [9], ([2, 3], [2, 3]), solver, policy=policy)
    np.testing.assert_array_equal(fixed_alone.tensions, [2, 3])


@each_solver
def test_the_direction_policy_never_renders_more_than_the_wrench(solver):
    result = tl.allocate([[1.0]], [2.0], (3.0, 5.0), solver, policy="direction")
    np.testing.assert_allclose(result.tensions, [3.0], atol=1e-7)
    assert result.status == tl.Status.NEAREST


@pytest.mark.parametrize("top", [0.0, 5e-6])
@pytest.mark.parametrize("angle", [1e-8, 1e-6, 3e-6, 4e-6, 6e-6, 8e-6, 1.2e-5, 1e-4])
def test_where_a_wrench_grazes_a_face_its_scale_falls_with_the_angle(angle, top):
    """The face is y <= top; moved outwards by the share of the tolerance that its angle allows, it ends it."""
    length, limits = 5.0, ([0, 1, 5 - top], [10, 5, 9])
    wrench = length * np.array([np.cos(angle), np.sin(angle)])
    share = TOLERANCE * length * np.clip(2 - 2 * np.sin(angle) / GRAZING, 0, 1)
    along = wrench[1] - 0.1 * share
    scale = min(1.0, (top + 0.9 * share) / along) if along > 0 else 1.0
    result = tl.allocate([[1, 0, 0], [0, 1, -1]], wrench, limits, "qp:daqp", policy="direction")
    assert result.tensions[0] == pytest.approx(scale * wrench[0], abs=1e-4)
    assert result.scale == pytest.approx(scale, abs=1e-4)


def test_a_wrench_missed_by_less_than_the_tolerance_is_reached_where_no_part_of_it_is_rendered_exactly():
    limits, wrench = ([1, 1, 5], [10, 5, 9]), 5 * np.array([1.0, 3e-6])
    result = tl.allocate([[1, 0, 0], [0, 1, -1]], wrench, limits, "qp:daqp", policy="direction")
    assert result.scale == pytest.approx(4.5 / 14.5, abs=1e-5)


@pytest.mark.parametrize(
    ("left", "wrench", "rendered"),
    [
        ((1.5, 2.0), 3.9, (1.9, 2.0)),  # the cable at its limit stays
        ((5e-4, 0.0), 6e-4, (6e-4, 0.0)),
        ((1.9995, 2.0), 3.9999, (1.9999, 2.0)),
        ((1.9, 2.0), 4.5, (1.9, 2.0)),  # beyond the limits
        ((0.1, 0.0), -0.5, (0.1, 0.0)),
    ],
)
def test_cables_between_their_limits_take_up_the_error_that_a_backend_leaves(left, wrench, rendered):
    structure, lower, upper = np.ones((1, 2)), np.zeros(2), np.full(2, 2.0)
    ray = Ray(structure, np.array([wrench]), lower, upper, lambda s: None)
    np.testing.assert_allclose(ray._polished(np.array(left), 1.0), rendered, atol=1e-12)
