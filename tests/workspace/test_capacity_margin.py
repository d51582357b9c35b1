import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import tensionlab as tl
from tests.helpers.examples import many
from tests.helpers.problems import cases, random_structure
from tests.helpers.reference_metrics import hull_margins, renders

ROOT = Path(__file__).parents[2]
CASES = json.loads((ROOT / "tests/data/known_answers.json").read_text())["cases"]
SIZES = [(1, 2), (2, 3), (2, 6), (3, 3), (3, 4), (3, 8), (4, 6), (5, 7), (6, 6), (6, 7), (6, 8), (6, 9)]
margin = tl.workspace.capacity_margin
gradient, rig_gradient = tl.workspace.margin_gradient, tl.workspace.rig_margin_gradient


@pytest.mark.parametrize(
    ("rig", "share"), [("cube-8", np.sqrt(8 / 3)), ("tetra-4", np.sqrt(2 / 3))], ids=["cube", "tetrahedron"]
)
def test_centre_of_a_cube(rig, share):
    rig = tl.load_rig(ROOT / "datasets/rigs" / f"{rig}.toml")
    room = rig.limits.upper[0] - rig.limits.lower[0]
    assert margin(rig.structure_matrix(rig.home), rig.limits) == pytest.approx(share * room, abs=1e-9)


def test_four_cables_along_the_axes():
    W = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    assert margin(W, (0.5, 6.0)) == pytest.approx(5.5, abs=1e-12)
    # The set is a square with corners at (+/-5.5, +/-5.5).
    assert margin(W, (0.5, 6.0), [5.0, 0.0]) == pytest.approx(0.5, abs=1e-12)
    assert margin(W, (0.5, 6.0), [7.0, 6.0]) == pytest.approx(-1.5, abs=1e-12)
    assert margin(W, (0.5, 6.0), [[5.0, 0.0], [0.0, -5.2]]) == pytest.approx(0.3, abs=1e-12)
    assert margin(W, (0.5, 6.0), ([1.0, 0.0], 2.0)) == pytest.approx(2.5, abs=1e-12)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_published_cases(case):
    found = margin(case["W"], (case["fmin"], case["fmax"]), case["wrench_to_produce"])
    assert found == pytest.approx(case["capacity_margin_about_wrench"], abs=1e-9)


def poses(seed, n, m, count):
    """Random structure matrices, each with its own limits."""
    rng = np.random.default_rng(seed)
    W = np.stack([random_structure(rng, min(n, 3) if n < 6 else 6, m) for _ in range(count)])
    if n in (4, 5):
        W = rng.normal(size=(count, n, m))
    elif n < 3:
        W = W[:, :n]
    lower = rng.uniform(0.0, 1.0, (count, m))
    return rng, W, lower, lower + rng.uniform(0.5, 6.0, (count, m))


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_qhull_agrees(n, m):
    count = many(40)
    rng, W, lower, upper = poses(n + 10 * m, n, m, count)
    inside = np.einsum("bnm,bkm->bkn", W, rng.uniform(lower[:, None], upper[:, None], (count, 3, m)))
    wrenches = inside * rng.uniform(0.3, 4.0, (count, 1, 1))
    expected = np.array([hull_margins(*each) for each in zip(W, lower, upper, wrenches, strict=True)])
    found = margin(W, (lower, upper), wrenches)
    np.testing.assert_allclose(found, expected.min(axis=1), rtol=0, atol=1e-9)
    ball = (wrenches[:, 0], np.linspace(0.0, 3.0, count))
    np.testing.assert_allclose(margin(W, (lower, upper), ball), expected[:, 0] - ball[1], rtol=0, atol=1e-9)
    assert np.any(expected[:, 0] > 0)
    assert np.any(expected[:, 0] < 0)


@given(cases())
def test_whatever_the_rank_its_sign_is_that_of_a_linear_program(case):
    found = margin(case.structure, case.limits, case.wrench)
    loose = case.upper > case.lower
    if np.linalg.matrix_rank(case.structure[:, loose], tol=1e-8) < len(case.wrench):
        assert found <= 0
    size = 1e-6 * max(1.0, float(np.abs(case.wrench).max()))
    if found < -size or found > size:
        assert renders(case.structure, *case.limits, case.wrench) == (found > 0)


def test_a_flat_set_ends_at_its_plane():
    W = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 0.0]])
    assert margin(W, (0.0, 5.0)) == 0
    assert margin(W, (0.0, 5.0), [1.0, 2.0, -0.25]) == pytest.approx(-0.25)
    assert margin(W, (0.0, 5.0), [6.0, 2.0, 0.25]) == pytest.approx(-1.0)
    assert margin(W[:, :1], (1.0, 5.0)) == pytest.approx(-1.0)
    assert margin(np.zeros((3, 4)), (0.0, 5.0), [3.0, 0.0, 4.0]) == -5
    assert margin(W[:, :1], (1.0, 5.0), [3.0, 0.0, 0.0]) == 0


@pytest.mark.parametrize("scale", [1e-53, 1e-8, 1e8, 1e75])
@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 6), (6, 8)])
def test_units_do_not_matter(n, m, scale):
    rng, W, lower, upper = poses(9, n, m, 10)
    wrench = np.einsum("bnm,bm->bn", W, (lower + upper) / 2)[:, None] + 0.2 * rng.normal(size=(10, 1, n))
    expected = margin(W, (lower, upper), wrench)
    np.testing.assert_allclose(margin(scale * W, (lower, upper), scale * wrench), scale * expected, rtol=1e-10)
    force = (scale * lower, scale * upper)
    np.testing.assert_allclose(margin(W, force, scale * wrench), scale * expected, rtol=1e-10)


def test_leading_axes_broadcast():
    W = np.random.default_rng(8).normal(size=(4, 1, 3, 6))
    limits = (0.0, np.linspace(1.0, 3.0, 5)[:, None])
    found = margin(W, limits)
    assert found.shape == (4, 5)
    assert margin(W[2, 0], (0.0, 2.0)) == pytest.approx(found[2, 2])
    assert isinstance(margin(W[0, 0], (0.0, 1.0)), float)
    assert margin(W[:0], limits).shape == (0, 5)


@pytest.mark.parametrize(
    ("structure", "required", "message"),
    [
        ([[np.nan, 1.0], [0.0, 1.0]], None, r"structure\[0, 0\] is nan"),
        (np.eye(7), None, "structure has 7 wrench components"),
        (np.eye(2), [1.0, 2.0, 3.0], "required wrenches have 3 components"),
        (np.eye(2), ([0.0, 0.0], -1.0), "required radius is -1"),
        (np.eye(2), np.zeros((0, 2)), "required has no wrench"),
        (np.ones((3, 2, 4)), np.zeros((2, 1, 2)), "leading axes do not broadcast together: structure"),
    ],
)
def test_bad_input_is_named(structure, required, message):
    with pytest.raises(tl.errors.ShapeError, match=message):
        margin(structure, (0.0, 1.0), required)


STEP = 1e-6


def differences(number, point):
    """Central differences of number(point) with respect to each entry."""
    found = np.empty(np.shape(point))
    for index in np.ndindex(found.shape):
        move = np.zeros(found.shape)
        move[index] = STEP
        found[index] = (number(point + move) - number(point - move)) / (2 * STEP)
    return found


@pytest.mark.parametrize(("n", "m"), [(1, 3), (2, 2), (2, 4), (3, 3), (3, 8), (5, 7), (6, 6), (6, 8)])
def test_by_the_structure_matrix(n, m):
    rng = np.random.default_rng(10 * n + m)
    for _ in range(5):
        W = random_structure(rng, 6 if n > 3 else max(n, 2), m)[:n]
        limits = rng.uniform(0.0, 1.0, m), rng.uniform(2.0, 6.0, m)
        for scale in (0.5, 10.0):  # inside and outside
            wrenches = W @ np.full(m, 2.0) + scale * rng.normal(size=(40, n))
            found = gradient(W, limits, wrenches)
            assert found.margin == margin(W, limits, wrenches)
            expected = differences(lambda W, wrenches=wrenches, limits=limits: margin(W, limits, wrenches), W)
            np.testing.assert_allclose(found.structure, expected, rtol=1e-5, atol=1e-6)


def test_off_a_flat_set_it_points_at_its_plane():
    # Moving a column towards the wrench moves the set by its tension; those in the plane are undecided, and share.
    W = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 0.0]])
    found = gradient(W, (0.0, 5.0), [0.0, 0.0, 2.0])
    assert found.margin == -2
    np.testing.assert_allclose(found.structure[:2], 0.0, atol=1e-15)
    np.testing.assert_array_equal(gradient(W, (0.0, 5.0)).structure, np.zeros((3, 4)))


def moved(rig, anchors):
    modules = [replace(module, anchor=anchor) for module, anchor in zip(rig.modules, anchors, strict=True)]
    return replace(rig, modules=tuple(modules))


def check_slopes(found, margin_at, rig, position, atol):
    """Compare the slopes by position and anchors with differences of a margin."""
    by_position = differences(lambda moved: margin_at(rig, moved), position)
    by_anchors = differences(lambda anchors: margin_at(moved(rig, anchors), position), rig.anchors)
    np.testing.assert_allclose(found.position, by_position, rtol=1e-5, atol=atol)
    np.testing.assert_allclose(found.anchors, by_anchors, rtol=1e-5, atol=atol)


@pytest.mark.parametrize("name", ["bartels2026-validation", "cube-8", "kntu-planar", "ipanema-2", "spidar-g6x4"])
def test_by_position_and_anchors(name):
    rig = tl.load_rig(ROOT / "datasets/rigs" / f"{name}.toml")
    rng = np.random.default_rng(3)
    size = 0.1 * np.abs(rig.anchors - rig.home).min(axis=0).clip(0.1)
    position = rig.home + size * rng.uniform(-1.0, 1.0, rig.dimension)
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    rotation = {"platform": turn, "planar": angle}.get(rig.kind)
    required = 0.1 * rng.normal(size=rig.n)
    found = rig_gradient(rig, position, rotation, required=required)

    def margin_at(rig, position):
        return margin(rig.structure_matrix(position, rotation), rig.limits, required)

    assert found.margin == margin_at(rig, position)
    check_slopes(found, margin_at, rig, position, 1e-7 * rig.limits.upper.max())


def test_anchors_on_a_body_move_in_its_axes():
    rig = tl.load_rig(ROOT / "datasets/rigs" / "body-mounted.toml")
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    frames = {name: ([0.1, -0.2, 0.05], turn * np.sign(np.linalg.det(turn))) for name in rig.frames}
    position = rig.home + np.array([0.02, 0.03, 0.01])
    found = rig_gradient(rig, position, frames=frames)

    def margin_at(rig, position):
        return margin(rig.structure_matrix(position, frames=frames), rig.limits)

    check_slopes(found, margin_at, rig, position, 1e-6)
