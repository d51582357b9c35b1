"""MuJoCo as an independent judge: the rigs of the repository, exported to it, as tendons on bodies.

MuJoCo computes the lengths and the Jacobian of the tendons and, when each tendon is pulled, the acceleration of
the body. Its free joint has the linear velocity in world axes and the angular velocity in body axes.
"""

import dataclasses
import xml.etree.ElementTree as Xml
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model.files import load_rig
from tensionlab.mujoco import gravity, structure_matrix

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
MASS = 2.0
INERTIA = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
STANCE = {
    "shoulder": ([-0.2, 1.4, 0.0], Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()),
    "hip": ([-0.15, 0.95, 0.0], Rotation.from_rotvec([-0.1, 0.4, 0.1]).as_matrix()),
}


def judge(rig, frames):
    """The model of a rig, with its body frames in place."""
    model = mujoco.MjModel.from_xml_string(rig_to_mjcf(rig))
    data = mujoco.MjData(model)
    stand(data, frames)
    mujoco.mj_forward(model, data)
    return model, data


def stand(data, frames):
    for name, (position, rotation) in (frames or {}).items():
        body = data.body(f"frame {name}").id
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        index = data.model.body_mocapid[body]
        data.mocap_pos[index], data.mocap_quat[index] = position, [w, x, y, z]


def place(data, rig, position, rotation):
    if rig.kind == "platform":
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        data.qpos[:] = [*position, w, x, y, z]
    else:
        data.qpos[:] = position if rotation is None else [*position, rotation]


def tendon_jacobian(model, data):
    """The derivative of the tendon lengths with respect to the joint velocities, one velocity at a time.

    The layout of ``ten_J`` depends on the version of MuJoCo; ``ten_velocity`` is ``ten_J @ qvel`` in all.
    """
    columns = []
    for velocity in np.eye(model.nv):
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        columns.append(data.ten_velocity.copy())
    data.qvel[:] = 0.0
    return np.stack(columns, axis=-1)


def scenes():
    """Twenty poses of each rig, away from home and turned."""
    rng = np.random.default_rng(11)
    for name in ("bartels2026-validation", "body-mounted", "ipanema-1", "ipanema-2", "cogiro", "kntu-planar"):
        for number in range(20):
            rig = load_rig(RIGS / f"{name}.toml")
            if rig.kind == "platform" and number % 3 == 2:
                skew = tl.Platform(MASS, com=[0.1, 0.05, -0.2], inertia=INERTIA)
                rig = dataclasses.replace(rig, platform=skew)
            reach = 0.05 * np.ptp(rig.anchors, axis=0).max()
            position = rig.home + rng.uniform(-reach, reach, size=rig.dimension)
            rotation = None
            if rig.kind == "planar":
                rotation = rng.uniform(-0.3, 0.3)
            elif rig.kind == "platform":
                rotation = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, size=3)).as_matrix()
            frames = STANCE if rig.frames else None
            yield pytest.param(rig, position, rotation, frames, id=f"{name}-{number}")


SCENES = list(scenes())


@pytest.mark.parametrize(("rig", "position", "rotation", "frames"), SCENES)
def test_the_judge_sees_the_same_cables(rig, position, rotation, frames):
    model, data = judge(rig, frames)
    place(data, rig, position, rotation)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.ten_length, rig.lengths(position, rotation, frames), atol=1e-12)
    jacobian = tendon_jacobian(model, data)
    if rig.kind == "platform":
        # From angular velocity in body axes to world axes: J_body = J_world R.
        jacobian[:, 3:] = jacobian[:, 3:] @ rotation.T
    expected = rig.structure_matrix(position, rotation, frames)
    np.testing.assert_allclose(jacobian, -expected.T, atol=1e-12)
    found = structure_matrix(model, data, [module.name for module in rig.modules], "platform")
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13)
    if rig.up is not None and rig.platform is not None:
        weight = rig.gravity(rotation)
        np.testing.assert_allclose(gravity(model, data, "platform"), weight, atol=1e-12 * abs(weight).max())


def acceleration(rig, rotation, wrench):
    """Newton and Euler from rest: acceleration of the reference point, angular acceleration in the world."""
    if rig.kind == "point":
        return wrench / 1.0  # a rig that knows no mass is exported with 1 kg
    mass, inertia = rig.platform.mass, rig.platform.inertia
    com = np.zeros(3) if rig.platform.com is None else np.append(rig.platform.com, np.zeros(3 - rig.dimension))
    if rig.kind == "planar":
        inertia, R = inertia * np.eye(3), Rotation.from_rotvec([0.0, 0.0, rotation]).as_matrix()
        force, torque = np.array([*wrench[:2], 0.0]), np.array([0.0, 0.0, wrench[2]])
    else:
        R, force, torque = rotation, wrench[:3], wrench[3:]
    arm = R @ com
    angular = np.linalg.solve(R @ inertia @ R.T, torque - np.cross(arm, force))
    linear = force / mass - np.cross(angular, arm)
    return np.concatenate([linear[:2], angular[2:]]) if rig.kind == "planar" else np.concatenate([linear, angular])


@pytest.mark.parametrize(("rig", "position", "rotation", "frames"), SCENES)
def test_allocated_tensions_accelerate_the_body_as_the_wrench_demands(rig, position, rotation, frames):
    structure = rig.structure_matrix(position, rotation, frames)
    # Each wrench comes from tensions well inside the limits, so that it can be rendered.
    lower, upper = rig.limits.lower, rig.limits.upper
    inside = np.random.default_rng(5).uniform(0.7 * lower + 0.3 * upper, upper, size=(4, rig.m))
    wrench = np.einsum("nm,km->kn", structure, inside)
    result = tl.allocate(structure, wrench, rig.limits).raise_for_status()
    model, data = judge(dataclasses.replace(rig, up=None, required=tl.Requirement()), frames)  # without weight
    for demanded, tensions in zip(wrench, result.tensions, strict=True):
        mujoco.mj_resetData(model, data)
        stand(data, frames)
        place(data, rig, position, rotation)
        data.ctrl[:] = tensions
        mujoco.mj_forward(model, data)
        force, found = data.qfrc_actuator.copy(), data.qacc.copy()
        if rig.kind == "platform":
            force[3:], found[3:] = rotation @ force[3:], rotation @ found[3:]
        np.testing.assert_allclose(force, demanded, atol=1e-9 * np.abs(demanded).max())
        expected = acceleration(rig, rotation, demanded)
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_rig_of_the_repository_starts_at_home_with_its_own_names(path):
    rig = load_rig(path)
    if path.stem == "body-mounted":
        turned = tl.RestPose("hip", [-0.15, 0.95, 0.0], [0.3, -0.2, 0.5])
        rig = dataclasses.replace(rig, rest=(rig.rest[0], turned))
    model, data = judge(rig, None)
    np.testing.assert_allclose(data.ten_length, rig.lengths(rig.home, frames=rig.at_rest), atol=1e-12)
    np.testing.assert_array_equal(data.qpos[: rig.dimension], rig.home)
    assert [model.actuator(i).name for i in range(model.nu)] == [module.name for module in rig.modules]
    np.testing.assert_array_equal(model.actuator_ctrlrange, [[m.lower, m.upper] for m in rig.modules])
    if rig.platform is not None:
        assert model.body("platform").mass == rig.platform.mass
    assert model.nv == rig.n


def test_motors_only_pull_and_stay_within_their_limits():
    rig = tl.load_rig(RIGS / "bartels2026-validation.toml")
    model, data = judge(rig, None)
    for control, applied in ((-5.0, 0.5), (0.0, 0.5), (3.0, 3.0), (99.0, 6.0)):
        data.ctrl[:] = control
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator, rig.structure_matrix(rig.home) @ np.full(4, applied))


@pytest.mark.parametrize(
    ("up", "falls"), [(None, [0, 0, 0]), ("z", [0, 0, -9.81]), ("-z", [0, 0, 9.81]), ("y", [0, -9.81, 0])]
)
def test_the_body_falls_where_the_rig_says_that_down_is(up, falls):
    rig = dataclasses.replace(load_rig(RIGS / "ipanema-1.toml"), up=up)
    _, data = judge(rig, None)  # the lower limits of this rig are zero
    np.testing.assert_allclose(data.qacc, [*falls, 0, 0, 0], atol=1e-9)
    assert ("No gravity" in rig_to_mjcf(rig)) == (up is None)
    assert "-0.0 " not in rig_to_mjcf(rig)


def test_a_planar_point_moves_in_its_plane():
    modules = tuple(tl.Module(f"m<{i}>", anchor, 0.5, 6.0) for i, anchor in enumerate([[1, 2], [-1, 2], [0, -1]]))
    rig = tl.Rig(name='a "flat" -- rig', kind="planar-point", modules=modules, home=[0.1, 0.2], description="--")
    model, data = judge(rig, None)
    data.ctrl[:] = [1, 2, 3]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, rig.structure_matrix([0.1, 0.2]) @ [1, 2, 3], atol=1e-12)


def test_what_mujoco_cannot_hold_is_refused():
    rig = load_rig(RIGS / "ipanema-1.toml")
    thin = tl.Platform(1.0, inertia=np.diag([1.0, 1.0, 2.1]))
    with pytest.raises(RigError, match=r"principal moments 1\.0 1\.0 2\.1"):
        rig_to_mjcf(dataclasses.replace(rig, platform=thin))
    rigid = dataclasses.replace(rig.modules[0], lower=3.0, upper=3.0)
    with pytest.raises(RigError, match=f'module "{rigid.name}": "lower" equals "upper"'):
        rig_to_mjcf(dataclasses.replace(rig, modules=(rigid,)))


def test_a_pulley_stands_on_the_side_of_the_cable_at_home_and_the_cable_passes_it_there():
    """All positions are in the axes of the pulley's body, whose origin is the anchor, where the cable comes in."""
    axis, anchor, radius = np.array([0.0, 0.0, 1.0]), np.array([0.7, 0.2, 1.5]), 0.1
    module = tl.Module("one", anchor, 0.5, 6.0, pulley_radius=radius, pulley_axis=axis, attachment=[0.0, 0.3, 0.0])
    other = tl.Module("two", [-1.0, 0.0, 0.0], 0.5, 6.0, attachment=[0.1, 0.0, 0.0])
    root = Xml.fromstring(rig_to_mjcf(tl.Rig("wheel", "platform", (module, other), home=[0.2, 0.6, 0.1])))
    (wheel,) = (geom for geom in root.iter("geom") if geom.get("name") == "one pulley")
    (side,) = (site for site in root.iter("site") if site.get("name") == "one rim")
    (start,) = (site for site in root.iter("site") if site.get("name") == "one anchor")
    ends = np.array(wheel.get("fromto").split(), float).reshape(2, 3)
    outward = np.array([-0.5, 0.7, 0.0]) / np.hypot(0.5, 0.7)  # to (0.2, 0.9), across the axis
    np.testing.assert_allclose(ends.mean(axis=0), radius * outward, atol=1e-12)
    assert abs(np.diff(ends, axis=0)[0] @ np.cross(axis, outward)) == pytest.approx(0.4 * radius)
    rim = np.array(side.get("pos").split(), float) - radius * outward
    assert rim @ outward < -radius
    assert rim @ axis > radius
    assert 0.0 < (anchor - np.array(start.get("pos").split(), float)) @ axis < 1e-5 * radius
