import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.benchmark.rigs import (
    border_path,
    desired_wrenches,
    near_singular,
    rotations,
    structures,
    workspace_samples,
)
from tensionlab.errors import RigError
from tensionlab.model.files import load_rig
from tensionlab.workspace import capacity_margin


@pytest.mark.parametrize(("n", "m"), [(3, 5), (6, 8)])
def test_every_column_is_a_cable(n, m):
    matrices = structures(np.random.default_rng(0), n, m, 50)
    assert matrices.shape == (50, n, m)
    np.testing.assert_allclose(np.linalg.norm(matrices[:, :3], axis=1), 1.0)
    if n == 6:  # the torque of a force is perpendicular to it
        np.testing.assert_allclose(np.sum(matrices[:, :3] * matrices[:, 3:], axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize(("n", "m"), [(3, 3), (3, 4), (3, 12), (6, 6), (6, 8)])
def test_near_singular_rigs_have_the_condition_asked_for(n, m):
    condition = np.geomspace(1e2, 1e7, 200)
    matrices = near_singular(np.random.default_rng(0), n, m, condition)
    np.testing.assert_allclose(np.linalg.cond(matrices), condition, rtol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(matrices[:, :3], axis=1), 1.0)


def test_a_quarter_turn_about_each_axis():
    found = rotations(np.eye(3), np.full(3, np.pi / 2)) @ np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(found, [[1, -3, 2], [3, 2, -1], [-2, 1, 3]], atol=1e-14)


def test_rotations_are_those_of_their_rotation_vectors():
    angle = np.array([0.3, -1.0, 2.5])
    axis = np.array([[0.6, 0.8, 0.0], [0.0, 0.6, -0.8], [1.0, 2.0, 2.0]]) / [[1.0], [1.0], [3.0]]
    expected = Rotation.from_rotvec(axis * angle[:, None]).as_matrix()
    np.testing.assert_allclose(rotations(axis, angle), expected, atol=1e-14)


def test_a_hanging_robot_holds_its_weight_at_its_centre_of_mass():
    rig = load_rig("cogiro")  # 91.058 kg at (-0.034, -0.013, 0.264) m
    weight = 91.058 * 9.81
    force = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    np.testing.assert_allclose(desired_wrenches(rig, force)[0], [0, 0, weight, -0.013 * weight, 0.034 * weight, 0])
    np.testing.assert_allclose(desired_wrenches(rig, force)[1, 3:], [-0.013 * weight, 0.034 * weight + 2.64, 0.13])
    upside_down = np.repeat(np.diag([1.0, -1.0, -1.0])[None], 2, axis=0)
    np.testing.assert_allclose(
        desired_wrenches(rig, force, upside_down)[0, 3:], [0.013 * weight, 0.034 * weight, 0]
    )


@pytest.mark.parametrize("name", ["ipanema-1", "spidar-g6x4"])
def test_robots_are_turned_moved_and_pushed_but_not_beyond_their_reach(name):
    rig = load_rig(name)
    structure, wrench = workspace_samples(np.random.default_rng(3), rig, 40)
    assert structure.shape == (40, 6, 8)
    assert np.ptp(structure, axis=0).min() > 0.0
    assert np.ptp(wrench, axis=0).min() > 0.0
    assert np.all(capacity_margin(structure, rig.limits, wrench[:, None]) > 0.0)
    weight = 0.0 if rig.platform is None else 9.81 * rig.platform.mass
    pushed = np.linalg.norm(wrench[:, :3] - [0.0, 0.0, weight], axis=1)
    assert pushed.max() <= 0.05 * rig.limits.upper.max()


@pytest.mark.parametrize("turning", [True, False])
def test_a_path_is_a_slow_loop_that_starts_inside_and_comes_back(turning):
    rig = load_rig("seven-modules")
    structure, wrench = border_path(np.random.default_rng(0), rig, 400, 0.3, 1.5, turning)
    np.testing.assert_allclose(np.linalg.norm(wrench, axis=1), 1.5)
    assert (np.ptp(wrench, axis=0).max() > 0.1) == turning
    closing = np.abs(structure[0] - structure[-1]).max(), np.abs(wrench[0] - wrench[-1]).max()
    assert max(closing) < 1.1 * max(np.abs(np.diff(each, axis=0)).max() for each in (structure, wrench))
    inside = capacity_margin(structure, rig.limits, wrench[:, None]) > 0.0
    assert inside[0] or turning
    assert 0.1 <= inside.mean() <= 0.9


def test_a_force_that_is_never_available_has_no_border():
    with pytest.raises(RigError, match=r"cube-8.*none of 200"):
        border_path(np.random.default_rng(0), load_rig("cube-8"), 50, 0.3, 1e3, False)


def test_a_robot_too_weak_for_its_weight_is_named():
    rig = load_rig("ipanema-1")
    heavy = dataclasses.replace(rig, platform=dataclasses.replace(rig.platform, mass=1e6))
    with pytest.raises(RigError, match=r"ipanema-1.*3 of 3 not found"):
        workspace_samples(np.random.default_rng(0), heavy, 3)
