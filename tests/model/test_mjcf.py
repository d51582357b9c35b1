"""MuJoCo as an independent judge: the same rigs, built from the same files, as tendons on bodies.

Every cable is a spatial tendon from an anchor site to an attachment site. MuJoCo computes the lengths and the
Jacobian of the tendons and, when each tendon is pulled, the acceleration of the body. Its free joint has the
linear velocity in world axes and the angular velocity in body axes.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.model.files import load_rig

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
X, Y, Z = (f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
JOINTS = {
    "point": X + Y + Z,
    "planar": X + Y + '<joint type="hinge" axis="0 0 1"/>',
    "platform": "<freejoint/>",
}
MASS = 2.0
INERTIA = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
STANCE = {
    "shoulder": ([-0.2, 1.4, 0.0], Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()),
    "hip": ([-0.15, 0.95, 0.0], Rotation.from_rotvec([-0.1, 0.4, 0.1]).as_matrix()),
}


def row(values):
    return " ".join(repr(float(value)) for value in values)


def in_space(point):
    return [*point, 0.0][:3]


def inertial(rig):
    """Mass, centre of mass in space and inertia in space; invented where the file says nothing."""
    mass, com, inertia = MASS, np.zeros(3), INERTIA
    if rig.platform is not None:
        mass = rig.platform.mass
        com = com if rig.platform.com is None else np.array(in_space(rig.platform.com))
        inertia = (
            rig.platform.inertia if rig.kind == "platform" else np.diag([1.0, 1.0, rig.platform.inertia[0, 0]])
        )
    return mass, com, inertia


def judge(rig, frames):
    """A MuJoCo model of a rig without gravity, with one motor on each cable."""
    bodies, cables, motors = [], [], []
    mass, com, inertia = inertial(rig)
    held = ""
    for i, module in enumerate(rig.modules):
        site = f'<site name="anchor{i}" pos="{row(in_space(module.anchor))}"/>'
        if module.frame == "world":
            bodies.append(site)
        else:
            position, rotation = frames[module.frame]
            x, y, z, w = Rotation.from_matrix(rotation).as_quat()
            bodies.append(f'<body pos="{row(position)}" quat="{row([w, x, y, z])}">{site}</body>')
        held += f'<site name="end{i}" pos="{row(in_space(rig.attachments[i]))}"/>'
        cables.append(f'<spatial name="cable{i}"><site site="anchor{i}"/><site site="end{i}"/></spatial>')
        motors.append(f'<motor tendon="cable{i}"/>')
    diagonal = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <compiler angle="radian" balanceinertia="false"/>
          <option gravity="0 0 0"><flag contact="disable"/></option>
          <worldbody>
            {"".join(bodies)}
            <body name="held">
              {JOINTS[rig.kind]}
              <inertial mass="{mass!r}" pos="{row(com)}" fullinertia="{row(diagonal)}"/>
              {held}
            </body>
          </worldbody>
          <tendon>{"".join(cables)}</tendon>
          <actuator>{"".join(motors)}</actuator>
        </mujoco>""")
    return model, mujoco.MjData(model)


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
    """Three poses of each rig, away from home and turned."""
    rng = np.random.default_rng(11)
    for name in ("bartels2026-validation", "body-mounted", "ipanema-2", "cogiro", "kntu-planar"):
        for number in range(3):
            rig = load_rig(RIGS / f"{name}.toml")
            reach = 0.05 * np.ptp(rig.anchors, axis=0).max()
            position = rig.home + rng.uniform(-reach, reach, size=rig.dimension)
            rotation = None
            if rig.kind == "planar":
                rotation = rng.uniform(-0.3, 0.3)
            elif rig.kind == "platform":
                rotation = Rotation.from_rotvec(rng.uniform(-0.15, 0.15, size=3)).as_matrix()
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
    np.testing.assert_allclose(jacobian, -rig.structure_matrix(position, rotation, frames).T, atol=1e-12)


def acceleration(rig, rotation, wrench):
    """Newton and Euler from rest: acceleration of the reference point, angular acceleration in the world."""
    mass, com, inertia = inertial(rig)
    if rig.kind == "point":
        return wrench / mass
    if rig.kind == "planar":
        c, s = np.cos(rotation), np.sin(rotation)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
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
    model, data = judge(rig, frames)
    for demanded, tensions in zip(wrench, result.tensions, strict=True):
        mujoco.mj_resetData(model, data)
        place(data, rig, position, rotation)
        data.ctrl[:] = -tensions  # a cable that pulls shortens its tendon
        mujoco.mj_forward(model, data)
        found = data.qacc.copy()
        if rig.kind == "platform":
            found[3:] = rotation @ found[3:]
        expected = acceleration(rig, rotation, demanded)
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
