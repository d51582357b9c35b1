from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.workspace import feasible_direction_fraction, squared_tension
from tests.helpers.examples import many
from tests.helpers.problems import random_structure
from tests.helpers.reference_metrics import evenness, renders

RIGS = Path(__file__).parents[2] / "datasets/rigs"
factor, closure = tl.workspace.tension_factor, tl.workspace.wrench_closure


def rig(name):
    return tl.load_rig(RIGS / f"{name}.toml")


def grid(height):
    """The poses of the published comparison: X -4..4, Y -3..3 in steps of 0.1 m, flattened."""
    x, y = np.meshgrid(np.arange(-40, 41) / 10, np.arange(-30, 31) / 10, indexing="ij")
    return np.stack([x, y, np.full_like(x, height)], axis=-1)


@pytest.mark.parametrize(("height", "count"), [(2.0, 3591), (3.0, 3575), (4.0, 3575)])
def test_closure_of_ipanema_2(height, count):
    found = closure(rig("ipanema-2").structure_matrix(grid(height)))
    assert found.shape == (81, 61)
    assert found.dtype == bool
    assert np.count_nonzero(found) == count


@pytest.mark.parametrize(
    ("name", "position", "expected"),
    [
        ("ipanema-1", (0.0, 0.0, 1.0), 1.0),
        ("ipanema-1", (1.2, 0.6, 1.0), 0.250555),
        ("ipanema-2", (0.5, 0.3, 2.5), 0.729983),
    ],
)
def test_published_tension_factors(name, position, expected):
    assert factor(rig(name).structure_matrix(position)) == pytest.approx(expected, abs=5e-7)


def test_alternate_corners_close_a_third_of_the_box():
    # The interior of the tetrahedron of its anchors.
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20_000, 3))
    tetra = tl.alternate_corners((1.0, 1.0, 1.0), limits=(0.5, 5.0))
    inside = closure(tetra.structure_matrix(points))
    weights = np.linalg.solve(
        np.vstack([tetra.anchors.T, np.ones(4)]), np.vstack([points.T, np.ones(len(points))])
    )
    assert np.array_equal(inside, (weights > 0).all(axis=0))
    assert inside.mean() == pytest.approx(1 / 3, abs=0.01)
    assert closure(tl.box_corners((1.0, 1.0, 1.0), limits=(0.5, 5.0)).structure_matrix(points)).all()


@pytest.mark.parametrize(
    ("n", "m"), [(1, 3), (2, 3), (2, 5), (3, 4), (3, 6), (4, 6), (5, 7), (6, 7), (6, 8), (6, 10)]
)
def test_a_linear_program_agrees(n, m):
    rng = np.random.default_rng(m)
    W = np.stack([random_structure(rng, 6 if n > 3 else max(n, 2), m)[:n] for _ in range(many(150))])
    W[::2, :, 0] -= W[::2].sum(axis=-1)  # every other one is balanced by equal tensions
    found, expected = factor(W), np.array([evenness(each) for each in W])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert found[::2] == pytest.approx(1.0, abs=1e-12)
    assert np.array_equal(closure(W), expected > 1e-9)


def test_no_closure_below_full_rank():
    tug_of_war = np.array([[1.0, -1.0], [0.0, 0.0]])
    assert factor(tug_of_war) == 0
    assert not closure(tug_of_war)
    assert factor(tug_of_war[:1]) == 1
    assert not closure(np.zeros((3, 5)))
    assert not closure(np.ones((6, 3)))


@pytest.mark.parametrize(("name", "dimension"), [("ipanema-2", 3), ("kntu-planar", 2)])
def test_isotropic_force_of_a_platform_is_rendered_without_torque(name, dimension):
    platform = rig(name)
    W = platform.structure_matrix(platform.home)
    force = tl.workspace.isotropic_force(W, platform.limits, dimension)
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(4000, dimension))
    if dimension == 2:
        angle = np.linspace(0, 2 * np.pi, 4000)
        directions = np.column_stack([np.cos(angle), np.sin(angle)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    wrenches = np.zeros((4000, platform.n))
    wrenches[:, :dimension] = directions
    reach = tl.allocate(W, 1e3 * wrenches, platform.limits, policy="direction").scale * 1e3
    assert reach.min() >= force - 1e-6
    assert reach.min() == pytest.approx(force, rel=0.02)


def test_dimension_counts_components():
    with pytest.raises(tl.errors.InputError, match="dimension is 4; of 3 wrench components"):
        tl.workspace.isotropic_force(np.eye(3), (0.0, 1.0), 4)


CROSS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
AROUND = np.array([[np.cos(a), np.sin(a)] for a in np.radians(np.arange(0.5, 360.0))])  # 360 directions of a plane


@pytest.mark.parametrize(
    ("n", "m", "d"), [(2, 3, 2), (3, 4, 3), (3, 6, 2), (6, 8, 3), (6, 8, 6), (6, 4, 6), (3, 2, 3)]
)
def test_a_linear_program_agrees_on_what_is_feasible(n, m, d):
    rng = np.random.default_rng(n + m + d)
    W, directions = random_structure(rng, n, m), rng.normal(size=(70, d))
    lower, upper = np.zeros(m), rng.uniform(2.0, 6.0, m)
    wrenches = np.zeros((70, n))
    wrenches[:, :d] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    expected = np.mean([renders(W, lower, upper, each) for each in wrenches])
    assert feasible_direction_fraction(W, (lower, upper), directions, 1.0) == pytest.approx(expected, abs=1e-12)


def test_effort_is_no_number_where_a_direction_is_infeasible():
    far = squared_tension(np.stack([CROSS, 3 * CROSS]), (0.0, 2.0), AROUND, 2.5)
    np.testing.assert_array_equal(np.isnan(far.mean), [True, False])
    np.testing.assert_array_equal(np.isnan(far.worst), [True, False])


def test_effort_in_parts_is_the_same(monkeypatch):
    rng = np.random.default_rng(3)
    W, directions = rng.normal(size=(3, 1, 3, 8)), rng.normal(size=(20, 3))
    limits = (0.0, rng.uniform(20.0, 30.0, (4, 8)))
    whole = squared_tension(W, limits, directions, 1.0)
    assert whole.mean.shape == (3, 4)
    one = squared_tension(W[2, 0], (0.0, limits[1][3]), directions, 1.0)
    assert one.mean == pytest.approx(whole.mean[2, 3])
    monkeypatch.setattr("tensionlab.workspace.structure_metrics.ALLOCATIONS_PER_CALL", 50)
    parts = squared_tension(W, limits, directions, 1.0)
    np.testing.assert_array_equal(parts.mean, whole.mean)
    np.testing.assert_array_equal(parts.worst, whole.worst)


@pytest.mark.parametrize(
    ("directions", "magnitude", "message"),
    [
        ([1.0, 0.0], 1.0, "directions must be a matrix"),
        (np.ones((4, 3)), 1.0, "d from 1 to 2"),
        ([[1.0, 0.0], [0.0, 0.0]], 1.0, r"directions\[1\] is zero"),
        (AROUND, -1.0, "magnitude is -1"),
    ],
)
def test_bad_input_is_named(directions, magnitude, message):
    error = tl.errors.InputError if message.startswith("magnitude") else tl.errors.ShapeError
    with pytest.raises(error, match=message):
        feasible_direction_fraction(CROSS, (0.0, 1.0), directions, magnitude)
    with pytest.raises(error, match=message):
        squared_tension(CROSS, (0.0, 1.0), directions, magnitude)
