from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.workspace import capacity_margin, margin_gradient, rig_margin_gradient
from tests.support.problems import random_structure

RIGS = Path(__file__).parents[2] / "datasets/rigs"
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
            found = margin_gradient(W, limits, wrenches)
            assert found.margin == capacity_margin(W, limits, wrenches)
            expected = differences(
                lambda W, wrenches=wrenches, limits=limits: capacity_margin(W, limits, wrenches), W
            )
            np.testing.assert_allclose(found.structure, expected, rtol=1e-5, atol=1e-6)


def test_a_ball_has_the_gradient_of_its_centre():
    rng = np.random.default_rng(1)
    W, centre = random_structure(rng, 3, 6), np.array([0.3, -0.2, 0.1])
    ball, point = margin_gradient(W, (0.5, 6.0), (centre, 0.25)), margin_gradient(W, (0.5, 6.0), centre)
    assert ball.margin == point.margin - 0.25
    np.testing.assert_array_equal(ball.structure, point.structure)


def test_a_cable_with_equal_limits_changes_it_as_a_constant_wrench():
    rng = np.random.default_rng(2)
    W, lower = random_structure(rng, 3, 6), np.full(6, 1.0)
    upper = np.array([5.0, 5.0, 1.0, 5.0, 5.0, 5.0])
    wrench = W @ np.full(6, 2.0) + 0.1
    expected = differences(lambda W: capacity_margin(W, (lower, upper), wrench), W)
    np.testing.assert_allclose(
        margin_gradient(W, (lower, upper), wrench).structure, expected, rtol=1e-6, atol=1e-7
    )


def test_off_a_flat_set_it_points_at_its_plane():
    # Moving a column towards the wrench moves the set by its tension; those in the plane are undecided, and share.
    W = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 0.0]])
    found = margin_gradient(W, (0.0, 5.0), [0.0, 0.0, 2.0])
    assert found.margin == -2
    np.testing.assert_allclose(found.structure[:2], 0.0, atol=1e-15)
    np.testing.assert_array_equal(margin_gradient(W, (0.0, 5.0)).structure, np.zeros((3, 4)))


def moved(rig, anchors):
    modules = [replace(module, anchor=anchor) for module, anchor in zip(rig.modules, anchors, strict=True)]
    return replace(rig, modules=tuple(modules))


@pytest.mark.parametrize("name", ["bartels2026-validation", "cube-8", "kntu-planar", "ipanema-2", "spidar-g6x4"])
def test_by_position_and_anchors(name):
    rig = tl.load_rig(RIGS / f"{name}.toml")
    rng = np.random.default_rng(3)
    size = 0.1 * np.abs(rig.anchors - rig.home).min(axis=0).clip(0.1)
    position = rig.home + size * rng.uniform(-1.0, 1.0, rig.dimension)
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    rotation = {"platform": turn, "planar": angle}.get(rig.kind)
    required = 0.1 * rng.normal(size=rig.n)
    found = rig_margin_gradient(rig, position, rotation, required=required)

    def margin(rig, position):
        return capacity_margin(rig.structure_matrix(position, rotation), rig.limits, required)

    assert found.margin == margin(rig, position)
    scale = rig.limits.upper.max()
    np.testing.assert_allclose(
        found.position, differences(lambda p: margin(rig, p), position), rtol=1e-5, atol=1e-7 * scale
    )
    np.testing.assert_allclose(
        found.anchors,
        differences(lambda anchors: margin(moved(rig, anchors), position), rig.anchors),
        rtol=1e-5,
        atol=1e-7 * scale,
    )


def test_anchors_on_a_body_move_in_its_axes():
    rig = tl.load_rig(RIGS / "body-mounted.toml")
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    frames = {name: ([0.1, -0.2, 0.05], turn * np.sign(np.linalg.det(turn))) for name in rig.frames}
    position = rig.home + np.array([0.02, 0.03, 0.01])
    found = rig_margin_gradient(rig, position, frames=frames)

    def margin(rig, position):
        return capacity_margin(rig.structure_matrix(position, frames=frames), rig.limits)

    np.testing.assert_allclose(
        found.anchors, differences(lambda a: margin(moved(rig, a), position), rig.anchors), rtol=1e-5, atol=1e-6
    )
    np.testing.assert_allclose(
        found.position, differences(lambda p: margin(rig, p), position), rtol=1e-5, atol=1e-6
    )


def test_many_poses_are_as_many_single_ones():
    rig = tl.load_rig(RIGS / "ipanema-2.toml")
    positions = rig.home + np.random.default_rng(5).uniform(-0.5, 0.5, (4, 3, 3))
    found = rig_margin_gradient(rig, positions)
    assert found.margin.shape == (4, 3)
    assert found.position.shape == (4, 3, 3)
    assert found.anchors.shape == (4, 3, 8, 3)
    one = rig_margin_gradient(rig, positions[2, 1])
    np.testing.assert_allclose(found.anchors[2, 1], one.anchors, rtol=1e-12, atol=1e-9)
