"""Orientation at home: whatever leaves the rotation out means the same as if it were given."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.hardware import World
from tensionlab.hardware.runner.state_estimation import PoseTracker
from tensionlab.interop.mujoco import RigBody
from tensionlab.model.files import rig_from_toml, rig_to_toml
from tensionlab.viewer import state
from tensionlab.workspace import box, cable_distance, certify

ROTATIONS = {"ipanema-1": [0.1, -0.2, 0.3], "kntu-planar": [0.2]}


@pytest.fixture(params=ROTATIONS)
def turned(request):
    rig = tl.load_rig(request.param)
    platform = tl.Platform(5.0, com=np.linspace(0.1, 0.2, rig.dimension))
    return replace(rig, platform=platform, up="y", home_rotation=ROTATIONS[request.param])


def test_a_pose_without_rotation_is_turned_as_at_home(turned):
    home, upright = turned.home_orientation, replace(turned, home_rotation=None)
    there = upright.structure_matrix(turned.home, home)
    assert np.abs(there - upright.structure_matrix(turned.home)).max() > 0.01
    np.testing.assert_array_equal(turned.structure_matrix(turned.home), there)
    np.testing.assert_array_equal(turned.gravity(), upright.gravity(home))
    np.testing.assert_array_equal(state.begin(turned).rotation, home)
    assert cable_distance(turned, turned.home)[0] == cable_distance(upright, turned.home, home)[0]
    found = turned.forward_kinematics(turned.lengths(turned.home))
    np.testing.assert_allclose(found.rotation, home, atol=1e-9)
    pose, structure = PoseTracker(turned).search(turned.lengths(turned.home), np.ones(turned.m, bool))
    np.testing.assert_allclose(pose.rotation, home, atol=1e-9)
    np.testing.assert_allclose(structure, there, atol=1e-9)


def test_sweeps_and_proofs_are_turned_as_at_home(turned):
    upright, near = replace(turned, home_rotation=None), [[each - 0.1, each + 0.1] for each in turned.home]
    grid, rotations = box(*near, step=0.1), turned.home_orientation[None]
    names = ["capacity-margin", "cable-distance"]
    with_rotation = tl.sweep(upright, box(*near, step=0.1, rotations=rotations), names)
    without = tl.sweep(turned, grid, names)
    for name in names:
        np.testing.assert_allclose(without[name].values, with_rotation[name].values[..., 0], rtol=1e-12)
    given = certify(upright, np.array(near), "wrench-closure", 0.05, rotations=rotations)
    assert certify(turned, np.array(near), "wrench-closure", 0.05).volume == given.volume


def test_a_body_of_mujoco_starts_turned_as_at_home(turned):
    weak = replace(turned, modules=tuple(replace(module, lower=0.1, upper=5.0) for module in turned.modules))
    pose = World(weak, RigBody(weak)).pose
    np.testing.assert_allclose(pose.position, turned.home, atol=1e-12)
    np.testing.assert_allclose(pose.rotation, turned.home_orientation, atol=1e-6)


def test_files_and_the_browser_keep_the_orientation_at_home(turned):
    assert rig_from_toml(rig_to_toml(turned), "text") == turned
    kept = state.make_home(state.begin(turned)).rig
    np.testing.assert_allclose(kept.home_rotation, turned.home_rotation, atol=1e-4)


def test_an_orientation_that_is_none_is_refused(turned):
    for rig, value in ((turned, [0.1, 0.2]), (tl.load_rig("cube-8"), [0.0, 0.0, 0.1])):
        with pytest.raises(RigError, match='"home_rotation"'):
            replace(rig, home_rotation=value)
