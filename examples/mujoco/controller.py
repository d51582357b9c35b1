"""Hold a platform in MuJoCo, move it along a path, and let it fall safely: python controller.py [solver]."""

import math
import sys
from pathlib import Path

import mujoco
import numpy as np

from tensionlab.mujoco import TendonAllocator, gravity

BODY = "platform"
HOLD_S, PATH_S, FALL_S = 1.0, 10.0, 7.0
STIFFNESS_1_S2, DAMPING_1_S = 400.0, 40.0
"""Critically damped, at 20 rad/s; by the mass, so that they are accelerations."""
FALL_M_S = 0.15
"""Speed at which the drag of the cables balances gravity."""


def path(time):
    """Return the desired position, velocity and acceleration: at rest, then on a figure of eight."""
    omega = 2.0 * math.pi / PATH_S
    size, turn = np.array([0.2, 0.1, 0.1]), np.array([1.0, 2.0, 1.0]) * omega
    along = min(max(time - HOLD_S, 0.0) / PATH_S, 1.0)
    # The time on the path, so that it starts and ends at rest: minimum jerk.
    now = PATH_S * along**3 * (10.0 - 15.0 * along + 6.0 * along**2)
    speed = 30.0 * along**2 * (1.0 - along) ** 2
    change = 60.0 * along * (1.0 - along) * (1.0 - 2.0 * along) / PATH_S
    sine, cosine = np.sin(turn * now), np.cos(turn * now)
    position = np.array([0.0, 0.0, 1.0]) + size * sine
    return position, size * turn * cosine * speed, size * turn * (cosine * change - turn * sine * speed**2)


def twist_of(model, data, body):
    """Return the velocity of a body's origin and its angular velocity, in world axes."""
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, linear, angular, body)
    return linear @ data.qvel, angular @ data.qvel


def follow(model, data, body, time):
    """Return the wrench that keeps the platform on its path and upright, against gravity."""
    position, velocity, acceleration = path(time)
    linear, angular = twist_of(model, data, body)
    error = position - data.xpos[body]
    turned = np.zeros(3)  # a rotation vector, in world axes as the platform is near upright
    mujoco.mju_quat2Vel(turned, data.xquat[body], 1.0)
    force = acceleration + STIFFNESS_1_S2 * error + DAMPING_1_S * (velocity - linear)
    moment = -STIFFNESS_1_S2 * turned - DAMPING_1_S * angular
    frame = data.ximat[body].reshape(3, 3)
    inertia = frame @ np.diag(model.body_inertia[body]) @ frame.T
    return np.concatenate([model.body_mass[body] * force, inertia @ moment]) - gravity(model, data, BODY)


def fall(model, data, body):
    """Return the wrench that only brakes: no spring, no weight is held, so that nothing can push the platform."""
    linear, angular = twist_of(model, data, body)
    weight = np.linalg.norm(gravity(model, data, BODY)[:3])
    return -np.concatenate([weight / FALL_M_S * linear, 2.0 * angular])


def simulate(solver="newton"):
    """Return times, positions, errors of the path in m, speeds downwards in m/s, and tensions."""
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("platform.xml")))
    data = mujoco.MjData(model)
    body = model.body(BODY).id
    tendons = [model.tendon(index).name for index in range(model.ntendon)]
    allocate = TendonAllocator(model, tendons, BODY, solver=solver, reference=20.0)
    rows = []
    while data.time < HOLD_S + PATH_S + FALL_S:
        data.mocap_pos[0, 0] = 0.1 * math.sin(data.time)  # the winches on the floor slide
        mujoco.mj_step1(model, data)
        falling = data.time > HOLD_S + PATH_S
        wrench = fall(model, data, body) if falling else follow(model, data, body, data.time)
        found = allocate(data, wrench)
        error = np.linalg.norm(path(data.time)[0] - data.xpos[body])
        rows.append([data.time, *data.xpos[body], error, -data.qvel[2], *found.tensions])
        mujoco.mj_step2(model, data)
    table = np.array(rows)
    return table[:, 0], table[:, 1:4], table[:, 4], table[:, 5], table[:, 6:]


if __name__ == "__main__":
    time, position, error, speed, tensions = simulate(*sys.argv[1:2])
    falling = time > HOLD_S + PATH_S
    holding = time < HOLD_S
    print(f"holds within {1e3 * error[holding].max():.3f} mm")
    print(f"follows its path within {1e3 * error[~holding & ~falling].max():.3f} mm")
    print(f"falls at up to {speed[falling].max():.3f} m/s, to a height of {position[-1, 2]:.3f} m")
    print(f"tensions from {tensions.min():.1f} to {tensions.max():.1f} N")
