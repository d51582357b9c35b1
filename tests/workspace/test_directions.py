import numpy as np
import pytest

import tensionlab as tl
from tensionlab.workspace import effort, isotropic_force, reachable_share
from tests.support.judges import renders
from tests.support.problems import random_structure

CROSS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
AROUND = np.array([[np.cos(a), np.sin(a)] for a in np.radians(np.arange(0.5, 360.0))])
"""360 directions of a plane."""


def test_a_square_is_reached_in_its_corners():
    # Up to 2 N along the axes: 2.2 N is reached where both components are at most 2 N.
    inside = np.abs(2.2 * AROUND).max(axis=1) <= 2.0
    assert 0.3 < inside.mean() < 0.9
    assert reachable_share(CROSS, (0.0, 2.0), AROUND, 2.2) == pytest.approx(inside.mean(), abs=1e-12)
    assert reachable_share(CROSS, (0.0, 2.0), 7.0 * AROUND, 2.0) == 1
    assert reachable_share(CROSS, (0.0, 2.0), AROUND, 2.9) == 0


@pytest.mark.parametrize(
    ("n", "m", "d"), [(2, 3, 2), (3, 4, 3), (3, 6, 2), (6, 8, 3), (6, 8, 6), (6, 4, 6), (3, 2, 3)]
)
def test_a_linear_program_agrees(n, m, d):
    rng = np.random.default_rng(n + m + d)
    W, directions = random_structure(rng, n, m), rng.normal(size=(70, d))
    lower, upper = np.zeros(m), rng.uniform(2.0, 6.0, m)
    wrenches = np.zeros((70, n))
    wrenches[:, :d] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    expected = np.mean([renders(W, lower, upper, each) for each in wrenches])
    assert reachable_share(W, (lower, upper), directions, 1.0) == pytest.approx(expected, abs=1e-12)


def test_all_is_reached_up_to_the_isotropic_force():
    rig = tl.box_corners((1.0, 1.0, 1.0), limits=(0.5, 5.0))
    W = rig.structure_matrix(np.random.default_rng(0).uniform(-0.4, 0.4, (30, 3)))
    directions = np.random.default_rng(1).normal(size=(500, 3))
    force = isotropic_force(W, rig.limits)
    least = float(force.min())
    assert np.all(reachable_share(W, rig.limits, directions, least) == 1)
    assert np.all(reachable_share(W, rig.limits, directions, 1.3 * float(force.max())) < 1)


def test_a_flat_set_reaches_along_its_plane():
    W = np.vstack([CROSS, np.zeros(4)])
    directions = np.vstack([np.eye(3), -np.eye(3)])
    assert reachable_share(W, (0.0, 2.0), directions, 1.5) == pytest.approx(4 / 6)
    assert reachable_share(W[:, :1], (0.0, 2.0), directions, 1.5) == pytest.approx(1 / 6)
    assert reachable_share(0 * W, (0.0, 2.0), directions, 1.5) == 0


def test_directions_of_each_pose():
    rng = np.random.default_rng(2)
    W, directions = rng.normal(size=(5, 3, 6)), rng.normal(size=(5, 40, 3))
    found = reachable_share(W, (0.0, 4.0), directions, 2.0)
    each = [reachable_share(*pair, 2.0) for pair in zip(W, [(0.0, 4.0)] * 5, directions, strict=True)]
    np.testing.assert_array_equal(found, each)


def test_effort_of_a_cross():
    # Opposite cables at 1 N and 1 N more, the others at 1 N: F = 1 costs 4 + 1 + 2.
    found = effort(CROSS, (1.0, 5.0), [[1.0, 0.0], [0.0, -2.0]], 1.0)
    assert found.mean == pytest.approx(7.0)
    assert found.worst == pytest.approx(7.0)
    diagonal = effort(CROSS, (0.0, 5.0), [[1.0, 0.0], [3.0, 4.0], [1.0, 1.0]], 2.0)
    assert diagonal.worst == pytest.approx(4.0)


def test_effort_is_no_number_where_a_direction_is_out_of_reach():
    far = effort(np.stack([CROSS, 3 * CROSS]), (0.0, 2.0), AROUND, 2.5)
    np.testing.assert_array_equal(np.isnan(far.mean), [True, False])
    np.testing.assert_array_equal(np.isnan(far.worst), [True, False])


def test_effort_in_parts_is_the_same(monkeypatch):
    rng = np.random.default_rng(3)
    W, directions = rng.normal(size=(3, 1, 3, 8)), rng.normal(size=(20, 3))
    limits = (0.0, rng.uniform(20.0, 30.0, (4, 8)))
    whole = effort(W, limits, directions, 1.0)
    assert whole.mean.shape == (3, 4)
    one = effort(W[2, 0], (0.0, limits[1][3]), directions, 1.0)
    assert one.mean == pytest.approx(whole.mean[2, 3])
    monkeypatch.setattr("tensionlab.workspace.directions.AT_ONCE", 50)
    parts = effort(W, limits, directions, 1.0)
    np.testing.assert_array_equal(parts.mean, whole.mean)
    np.testing.assert_array_equal(parts.worst, whole.worst)


@pytest.mark.parametrize(
    ("directions", "magnitude", "message"),
    [
        ([1.0, 0.0], 1.0, "directions must be a matrix"),
        (np.zeros((0, 2)), 1.0, r"directions have shape \(0, 2\)"),
        (np.ones((4, 3)), 1.0, "d from 1 to 2"),
        ([[1.0, 0.0], [0.0, 0.0]], 1.0, r"directions\[1\] is zero"),
        (AROUND, -1.0, "magnitude is -1"),
        (AROUND, np.nan, "magnitude is nan"),
    ],
)
def test_bad_input_is_named(directions, magnitude, message):
    with pytest.raises(tl.ShapeError, match=message):
        reachable_share(CROSS, (0.0, 1.0), directions, magnitude)
    with pytest.raises(tl.ShapeError, match=message):
        effort(CROSS, (0.0, 1.0), directions, magnitude)
