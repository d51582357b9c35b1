"""Bases and metrics that respect the rank of the structure matrix."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.solvers.programs import independent_rows, times, whitener


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


@pytest.mark.parametrize("solver", ["qp:daqp", "qp:clarabel", "cvxpy"])
@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_beside_a_cable_with_equal_limits_programs_have_newtons_answer(solver, policy):
    """The third cable always pulls with 2 N; the last wrench is feasible, the first one on its ray."""
    structure = np.array([[1.0, -0.6, -0.6, 0.3], [0.0, 0.8, -0.8, 0.9]])
    limits = ([1.0, 1.0, 2.0, 1.0], [8.0, 8.0, 2.0, 8.0])
    feasible = structure @ [4.0, 2.0, 2.0, 5.0]
    wrenches = [3.0 * feasible, [12.0, 6.0], [-9.0, 20.0], [3.0, -30.0], feasible]
    expected = tl.allocate(structure, wrenches, limits, policy=policy)
    found = tl.allocate(structure, wrenches, limits, solver, policy=policy)
    assert expected.status.tolist() == [tl.Status.NEAREST] * 4 + [tl.Status.EXACT]
    assert (found.status == expected.status).all()
    np.testing.assert_allclose(found.tensions, expected.tensions, atol=1e-5)
