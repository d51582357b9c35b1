"""Carry a suspended platform at 6.8 m/s² in MuJoCo by planned tensions: python carry.py [figure.png]."""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import tensionlab as tl
from tensionlab.mujoco import RigBody

DT, PART = 2e-3, 4  # time between tensions, in s, and steps of MuJoCo in each
RATE = 300.0  # largest rate of a tension, in N/s


def suspended():
    """Return CoGiRo at a quarter of its size, with a platform of 5 kg and winches of 1 to 100 N."""
    large = tl.load_rig("cogiro")
    modules = tuple(
        replace(each, anchor=each.anchor / 4, attachment=each.attachment / 4, lower=1.0, upper=100.0)
        for each in large.modules
    )
    platform = tl.Platform(5.0, inertia=np.diag([0.05, 0.05, 0.06]))
    return replace(large, name="suspended", modules=modules, home=[-0.5, 0.0, 0.35], platform=platform)


def carry(rig, path):
    """Return the planned tensions (K, m), and the position and turn (K, 3) of the platform that they carry."""
    structure = rig.structure_matrix(path.position, path.rotation)
    plan = tl.allocate_path(structure, tl.inverse_dynamics(rig, path), rig.limits, RATE, DT)
    print(plan)
    body = RigBody(rig, path.position[0])
    body.held = False
    poses = [body(0.0)]
    for now, later in zip(plan.tensions[:-1], plan.tensions[1:], strict=True):
        body.apply_tensions((now + later) / 2)  # nothing is measured: these tensions alone hold it on its way
        start = (len(poses) - 1) * DT
        poses.append([body(start + DT * part / PART) for part in range(1, PART + 1)][-1])
    return plan.tensions, np.array([pose.position for pose in poses]), np.array([pose.rotation for pose in poses])


def main():
    """Carry the platform a metre and back, and draw how."""
    rig = suspended()
    there = rig.home + np.array([1.0, 0.0, 0.0])
    path = tl.Trajectory.through([rig.home, there, rig.home], [0.0, 0.922, 1.844], [np.eye(3)] * 3, step=DT)
    tensions, position, rotation = carry(rig, path)
    error = 1e3 * np.linalg.norm(position - path.position, axis=1)
    turn = np.degrees(np.arccos(np.clip((np.trace(rotation, axis1=1, axis2=2) - 1) / 2, -1.0, 1.0)))
    print(f"{path}\nlargest error {error.max():.2f} mm, largest turn {turn.max():.3f}°")
    if len(sys.argv) > 1:
        draw(path, tensions, error).savefig(sys.argv[1], dpi=120)


def draw(path, tensions, error):
    """Return a figure of the acceleration, the tensions and the error over time."""
    with tl.plots.styled():
        figure, (above, middle, below) = plt.subplots(3, 1, figsize=(8, 7), sharex=True, layout="constrained")
        above.plot(path.times, path.acceleration[:, 0])
        middle.plot(path.times, tensions)
        below.plot(path.times, error)
        figure.suptitle(f"5 kg, {abs(path.acceleration).max():.1f} m/s², carried within {error.max():.2f} mm")
        for axes, label in ((above, "acceleration (m/s²)"), (middle, "tensions (N)"), (below, "error (mm)")):
            axes.set_ylabel(label)
            axes.grid()
        below.set(xlabel="time (s)", xlim=(0.0, path.times[-1]), ylim=(0.0, 1.0))
    return figure


if __name__ == "__main__":
    main()
