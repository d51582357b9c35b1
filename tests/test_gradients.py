"""Derivatives of the tensions against differences, known ones, and what is said at kinks."""

import importlib
import sys

import numpy as np
import pytest

import tensionlab as tl
from tests.helpers.problems import random_cases

TUG_OF_WAR = np.array([[1.0, -1.0]])


def test_a_wrench_shared_by_equal_cables_changes_each_by_its_share():
    jacobian = tl.allocation_jacobian([[1.0, 1.0]], [4.0], (0.0, 5.0))
    np.testing.assert_allclose(jacobian.wrench, [[0.5], [0.5]])
    # t = w W' / |W|²: a longer first column takes 2 · (1/2) from its own cable, and 2 from the other.
    np.testing.assert_allclose(jacobian.structure[:, 0], [[0.0, -2.0], [-2.0, 0.0]], atol=1e-14)
    assert not jacobian.kink


def test_the_cable_at_its_limit_stays_there_and_moves_with_the_limit():
    jacobian = tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0))
    np.testing.assert_allclose(jacobian.wrench, [[1.0], [0.0]])
    gradients = jacobian.pull_back([1.0, 10.0])
    np.testing.assert_allclose(gradients.lower, [0.0, 11.0])
    assert not gradients.upper.any()


def test_beyond_the_edge_the_nearest_force_stays_and_a_direction_turns():
    rig = tl.load_rig("bartels2026-validation")
    structure, wrench = rig.structure_matrix(rig.home), np.array([20.0, 1.0, 2.0])
    for policy in ("force", "direction"):
        jacobian = tl.allocation_jacobian(structure, wrench, rig.limits, policy=policy)
        assert jacobian.allocation.status == tl.Status.NEAREST
        assert not jacobian.kink
        rendered = structure @ jacobian.wrench
        if policy == "direction":  # a longer wrench is rendered as before
            np.testing.assert_allclose(rendered @ wrench, 0.0, atol=1e-12)
            assert np.abs(rendered).max() > 0.1
        else:  # what is moved off the face changes nothing, what is moved along it all
            error = wrench - jacobian.allocation.wrench
            np.testing.assert_allclose(rendered @ error, 0.0, atol=1e-12)
            np.testing.assert_allclose(rendered, rendered @ rendered, atol=1e-12)


def test_a_cable_that_just_meets_its_limit_is_a_kink():
    # 4 N is what both render with the second at 1 N and the first at its 5 N.
    found = tl.allocation_jacobian(TUG_OF_WAR, [[3.9], [4.0], [4.1]], (1.0, 5.0))
    assert found.kink.tolist() == [False, True, False]
    # The reference is met where nothing has to be changed: no cable is held.
    assert not tl.allocation_jacobian(TUG_OF_WAR, [0.0], (1.0, 5.0), reference=2.0).kink
    # The second cable comes to its limit of 1 N just there, and nothing holds it: the derivative to one side.
    edge = tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0), reference=2.0)
    assert edge.kink
    np.testing.assert_allclose(edge.wrench, [[1.0], [0.0]])


def test_a_structure_whose_rank_would_change_is_a_kink():
    flat = np.array([[1.0, 1.0, -1.0], [0.0, 0.0, 0.0]])
    for policy in ("force", "tension", "direction"):
        jacobian = tl.allocation_jacobian(flat, [1.0, 0.0], (0.0, 5.0), reference="middle", policy=policy)
        assert jacobian.kink
        assert np.isfinite(jacobian.structure).all()
    # Two cables side by side on the nearest face share by the reference, until they are no longer parallel.
    twins = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    jacobian = tl.allocation_jacobian(twins, [4.0, 9.0], (0.0, 5.0))
    assert jacobian.allocation.tensions.tolist() == [2.0, 2.0, 5.0]
    assert jacobian.kink
    np.testing.assert_allclose(jacobian.wrench, [[0.5, 0.0], [0.5, 0.0], [0.0, 0.0]], atol=1e-14)


def test_a_cable_without_play_follows_its_limits_and_is_no_kink():
    limits = np.array([2.0, 0.0, 0.0]), np.array([2.0, 9.0, 9.0])
    jacobian = tl.allocation_jacobian([[1.0, 1.0, 1.0]], [6.0], limits, reference="lower")
    np.testing.assert_allclose(jacobian.wrench, [[0.0], [0.5], [0.5]])
    gradients = jacobian.pull_back([0.0, 1.0, 0.0])
    assert not jacobian.kink
    np.testing.assert_allclose(gradients.lower + gradients.upper, [-0.5, 0.0, 0.0])


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_products_are_those_of_the_arrays(policy):
    cases = random_cases(1, 3, 6, 300)
    options = {"reference": cases.reference, "policy": policy, "wrench_weights": cases.weights}
    jacobian = tl.allocation_jacobian(cases.structure, cases.wrench, cases.limits, **options)
    cotangent = np.random.default_rng(2).normal(size=(300, 6))
    gradients = jacobian.pull_back(cotangent)
    by_structure = np.einsum("bi,binm->bnm", cotangent, jacobian.structure)
    np.testing.assert_allclose(gradients.structure, by_structure, rtol=1e-9, atol=1e-9)
    by_wrench = np.einsum("bi,bin->bn", cotangent, jacobian.wrench)
    np.testing.assert_allclose(gradients.wrench, by_wrench, rtol=1e-9, atol=1e-9)
    assert {*np.unique(jacobian.allocation.status)} == {tl.Status.EXACT, tl.Status.NEAREST}


def test_leading_axes_broadcast_and_rows_have_their_own_limits():
    rng = np.random.default_rng(3)
    structure, wrench = rng.normal(size=(4, 1, 2, 5)), rng.normal(size=(3, 2))
    limits = rng.uniform(0.0, 0.1, (4, 1, 5)), 2.0
    jacobian = tl.allocation_jacobian(structure, wrench, limits, reference="lower")
    assert jacobian.wrench.shape == (4, 3, 5, 2)
    assert jacobian.structure.shape == (4, 3, 5, 2, 5)
    assert jacobian.kink.shape == (4, 3)
    gradients = jacobian.pull_back(np.ones(5))
    assert [each.shape for each in gradients] == [(4, 3, 2, 5), (4, 3, 2), *3 * [(4, 3, 5)]]
    alone = tl.allocation_jacobian(structure[2, 0], wrench[1], (limits[0][2, 0], 2.0), reference="lower")
    np.testing.assert_array_equal(jacobian.structure[2, 1], alone.structure)


def test_batches_on_threads_have_the_same_derivatives(monkeypatch):
    cases = random_cases(4, 6, 8, 3000)
    found = []
    for threads in "13":
        monkeypatch.setenv("TENSIONLAB_NUM_THREADS", threads)
        jacobian = tl.allocation_jacobian(cases.structure, cases.wrench, cases.limits)
        found.append((jacobian.structure, *jacobian.pull_back(np.ones(8))))
    for one, several in zip(*found, strict=True):
        np.testing.assert_array_equal(one, several)


def test_an_empty_batch_has_empty_derivatives():
    jacobian = tl.allocation_jacobian(np.ones((0, 2, 3)), np.ones(2), (0.0, 1.0))
    assert jacobian.structure.shape == (0, 3, 2, 3)
    assert jacobian.pull_back(np.ones(3)).wrench.shape == (0, 2)


def test_other_solvers_are_refused_by_what_they_minimise():
    with pytest.raises(
        tl.errors.InputError, match=r"'minimax', which minimises 'least largest tension'; .* 'newton' alone"
    ):
        tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0), solver="minimax")
    with pytest.raises(tl.errors.InputError, match="leave solver out"):
        tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0), solver=tl.solvers.Dykstra())
    tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0), solver=tl.solvers.Newton())


def test_a_cotangent_must_fit():
    jacobian = tl.allocation_jacobian(TUG_OF_WAR, [2.0], (1.0, 5.0))
    with pytest.raises(tl.errors.ShapeError, match=r"cotangent has shape \(3,\), .* the tensions' \(2,\)"):
        jacobian.pull_back(np.ones(3))
    with pytest.raises(tl.errors.ShapeError, match=r"cotangent\[1\] is nan"):
        jacobian.pull_back([1.0, np.nan])


@pytest.mark.parametrize("library", ["jax", "torch"])
def test_a_library_that_is_missing_is_named_with_its_extra(monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    wrapper = importlib.import_module(f"tensionlab.{library}")
    with pytest.raises(
        tl.errors.MissingDependency, match=rf'needs {library}.*: pip install "tensionlab\[{library}\]"'
    ):
        wrapper.allocate(TUG_OF_WAR, [2.0], (1.0, 5.0))
