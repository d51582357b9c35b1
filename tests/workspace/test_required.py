"""What is required of a rig, in metrics: by the answers of the allocation, and by scale."""

import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.model.directions import fibonacci
from tensionlab.model.kinematics import exponential
from tensionlab.workspace.wrench_set import required_margin

COGIRO = tl.load_rig("cogiro")


def scattered(count, seed=0):
    """Poses of CoGiRo, some of them beyond what it can do, turned a little."""
    rng = np.random.default_rng(seed)
    position = rng.uniform([-7.0, -5.0, 0.5], [7.0, 5.0, 5.2], (count, 3))
    return tl.workspace.PoseList(position, exponential(rng.normal(scale=0.1, size=(count, 3))))


@pytest.mark.parametrize(
    "required",
    [
        tl.Requirement(gravity=True),
        tl.Requirement(gravity=True, box=[100.0, 100.0, 200.0, 0.0, 0.0, 30.0]),
        tl.Requirement(wrench=[0.0, 0.0, 900.0, 0.0, 0.0, 0.0]),
    ],
    ids=["weight", "box", "wrench"],
)
def test_a_pose_is_feasible_where_every_corner_has_exact_tensions(required):
    poses = scattered(200)
    structure = COGIRO.structure_matrix(poses.position, poses.rotation)
    corners = np.broadcast_to(required.at(COGIRO, poses.rotation), (200, len(required.at(COGIRO)), 6))
    found = tl.allocate(structure[:, None], corners, COGIRO.limits)
    expected = (found.status == tl.Status.EXACT).all(axis=1)
    assert 0.1 < expected.mean() < 0.9
    data = tl.sweep(COGIRO, poses, ["wrench-feasible", "capacity-margin"], required=required)
    np.testing.assert_array_equal(data["wrench-feasible"].values[0] > 0, expected)
    np.testing.assert_array_equal(data["capacity-margin"].values[0] > 0, expected)


def test_a_wrench_of_each_pose_is_required_in_addition():
    """The same as if each pose were swept alone with its own required wrench; a force has no torque."""
    poses = scattered(6)
    wrenches = np.random.default_rng(1).normal(scale=300.0, size=(6, 6))
    metrics = ["wrench-feasible", "capacity-margin", "squared-tension:worst", "isotropic-force"]
    for given in (wrenches, wrenches[:, :3]):
        found = tl.sweep(COGIRO, tl.workspace.PoseList(poses.position, poses.rotation, given), metrics)
        for number, wrench in enumerate(given):
            alone = tl.sweep(
                COGIRO,
                poses.block((slice(number, number + 1),)),
                metrics,
                required=tl.Requirement(wrench=np.pad(wrench, (0, 6 - len(wrench))), gravity=True),
            )
            for name in metrics:
                np.testing.assert_allclose(found[name].values[..., number], alone[name].values[..., 0], rtol=1e-9)
    assert found["Fz"].values.tolist() == wrenches[:, 2].tolist()
    with pytest.raises(SweepError, match="the poses have torques"):
        tl.sweep(tl.load_rig("cube-8"), tl.workspace.PoseList([[0.0, 0.0, 0.0]], wrench=np.ones((1, 6))), metrics)


def test_margins_do_not_depend_on_the_unit_of_length():
    """A robot of three times the size is as strong: in N, its torques are at three times the arm."""
    modules = [dataclasses.replace(m, anchor=3 * m.anchor, attachment=3 * m.attachment) for m in COGIRO.modules]
    platform = tl.Platform(COGIRO.platform.mass, com=3 * COGIRO.platform.com)
    large = dataclasses.replace(COGIRO, modules=tuple(modules), home=3 * COGIRO.home, platform=platform)
    assert large.characteristic_length == pytest.approx(3 * COGIRO.characteristic_length)
    poses = scattered(30)
    small_margin = required_margin(
        COGIRO, COGIRO.structure_matrix(poses.position, poses.rotation), COGIRO.required, poses.rotation
    )
    large_margin = required_margin(
        large, large.structure_matrix(3 * poses.position, poses.rotation), large.required, poses.rotation
    )
    np.testing.assert_allclose(large_margin, small_margin, rtol=1e-9)


def test_isotropic_force_share_and_squared_tension_are_beside_the_weight():
    structure, weight = COGIRO.structure_matrix(COGIRO.home), COGIRO.required.middle(COGIRO)
    force = tl.workspace.isotropic_force(structure, COGIRO.limits, 3, weight)
    wrenches = np.zeros((500, 6))
    wrenches[:, :3] = fibonacci(500)
    inside = tl.allocate(structure, weight + 0.999 * force * wrenches, COGIRO.limits)
    outside = tl.allocate(structure, weight + 1.02 * force * wrenches, COGIRO.limits)
    assert (inside.status == tl.Status.EXACT).all()
    share = np.mean(outside.status == tl.Status.EXACT)
    assert share < 1
    directions = wrenches[:, :3]
    assert tl.workspace.feasible_direction_fraction(
        structure, COGIRO.limits, directions, 1.02 * force, weight
    ) == pytest.approx(share)
    squares = (inside.tensions**2).sum(axis=1)
    found = tl.workspace.squared_tension(structure, COGIRO.limits, directions, 0.999 * force, weight)
    assert found == pytest.approx((squares.mean(), squares.max()))
    names = ["isotropic-force", "feasible-direction-fraction:100", "squared-tension"]
    data = tl.sweep(COGIRO, [COGIRO.home], names)
    assert data["isotropic-force"].item() == pytest.approx(force)
    assert data["feasible-direction-fraction:100"].item() == 1.0
    assert tl.workspace.isotropic_force(structure, COGIRO.limits, 3) == 0.0
