"""Wrenches out of reach in the exact solver: the nearest face, and what it leaves to surer steps."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import tensionlab as tl
from benchmarks.solver_speed import LOWER, UPPER, infeasible_wrenches, random_problems


@pytest.mark.parametrize("weights", [None, (1.0, 4.0, 0.25)])
@pytest.mark.parametrize("cables", [3, 4, 5, 8, 12])
def test_the_nearest_wrench_is_bounded_least_squares(cables, weights):
    structure, inside = random_problems(3, cables, 100, seed=1)
    wrench = infeasible_wrenches(structure, inside, seed=1)
    found = tl.allocate(structure, wrench, (LOWER, UPPER), wrench_weights=weights)
    assert (found.status == tl.Status.NEAREST).all()
    root = np.sqrt(np.ones(3) if weights is None else weights)
    for W, w, tensions in zip(structure, wrench, found.tensions, strict=True):
        best = lsq_linear(root[:, None] * W, root * w, (LOWER, UPPER), method="bvls", tol=1e-14)
        np.testing.assert_allclose(tensions, best.x, atol=1e-6)


def test_the_nearest_tension_is_bounded_least_squares_of_whitened_rows():
    structure, inside = random_problems(6, 8, 100, seed=2)
    wrench = infeasible_wrenches(structure, inside, seed=2)
    found = tl.allocate(structure, wrench, (LOWER, UPPER), policy="tension")
    assert (found.status == tl.Status.NEAREST).all()
    for W, w, tensions in zip(structure, wrench, found.tensions, strict=True):
        to_unit = np.linalg.inv(np.linalg.cholesky(W @ W.T))
        best = lsq_linear(to_unit @ W, to_unit @ w, (LOWER, UPPER), method="bvls", tol=1e-14)
        np.testing.assert_allclose(tensions, best.x, atol=1e-6)


@pytest.mark.parametrize("policy", ["force", "tension"])
def test_free_cables_along_one_another_share_as_the_reference_does(policy):
    structure = [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    for reference, expected in (((0, 0, 0), (10, 4, 4)), ((0, 2, 0), (10, 5, 3)), ((0, 9, 0), (10, 7, 1))):
        found = tl.allocate(structure, (20.0, 8.0), (1.0, 10.0), reference=reference, policy=policy)
        assert found.status == tl.Status.NEAREST
        np.testing.assert_allclose(found.tensions, expected, atol=1e-9)


def test_a_cable_that_cannot_help_stays_at_the_reference():
    structure = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]  # the third renders nothing
    found = tl.allocate(structure, (20.0, 5.0), (1.0, 10.0), reference=(0.0, 0.0, 6.0))
    assert found.status == tl.Status.NEAREST
    np.testing.assert_allclose(found.tensions, (10.0, 5.0, 6.0), atol=1e-9)


def test_a_free_cable_may_be_just_at_its_limit():
    found = tl.allocate(np.eye(2), (20.0, 1.0), (1.0, 10.0))
    assert found.status == tl.Status.NEAREST
    np.testing.assert_allclose(found.tensions, (10.0, 1.0), atol=1e-9)


@pytest.mark.parametrize(("components", "cables"), [(2, 3), (3, 4), (3, 5), (3, 8), (6, 8)])
def test_an_answer_does_not_depend_on_the_others_of_its_batch(components, cables):
    """Where some are within reach, some just out of it, and some far."""
    structure, inside = random_problems(components, cables, 240, seed=4)
    wrench = infeasible_wrenches(structure, inside, seed=4)
    wrench[::3] = inside[::3]
    edge = tl.allocate(structure[1::3], wrench[1::3], (LOWER, UPPER), policy="direction")
    wrench[1::3] *= np.nan_to_num(edge.scale * (1.0 + 1e-12), nan=1.0)[:, None]
    found = tl.allocate(structure, wrench, (LOWER, UPPER))
    assert np.isin(found.status, (tl.Status.EXACT, tl.Status.NEAREST)).all()
    order = np.random.default_rng(4).permutation(240)
    shuffled = tl.allocate(structure[order], wrench[order], (LOWER, UPPER))
    for name in ("tensions", "status", "iterations", "separation"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(found, name)[order], err_msg=name)


@pytest.mark.parametrize(("components", "cables"), [(3, 4), (3, 8), (3, 12), (6, 8)])
def test_it_takes_about_as_many_steps_as_within_reach(components, cables):
    structure, inside = random_problems(components, cables, 2000, seed=3)
    limits = (LOWER, UPPER)
    within = tl.allocate(structure, inside, limits).iterations.mean()
    for policy in ("force", "tension"):
        out = tl.allocate(structure, infeasible_wrenches(structure, inside, seed=3), limits, policy=policy)
        assert (out.status == tl.Status.NEAREST).all()
        assert out.iterations.mean() < 2.2 * within
