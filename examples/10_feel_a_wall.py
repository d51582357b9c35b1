"""Render a haptic effect: the force of a wall on a hand that presses into it, and the tensions for it."""

import numpy as np

import tensionlab as tl
from tensionlab.haptics.effects import Motion, Plane, Wall

rig = tl.load_rig("bartels2026-validation")
wall = Wall(Plane(point=tuple(rig.home), normal=(0.0, 1.0, 0.0)), stiffness=300.0, damping=0.0)

depths = np.linspace(-0.002, 0.01, 7)
positions = rig.home - np.outer(depths, [0.0, 1.0, 0.0])
force = wall.render(Motion(positions, np.zeros_like(positions))).force
result = rig.allocate(force, positions)
for depth, push, exact in zip(depths, force[:, 1], result.exact, strict=True):
    print(f"{1000 * depth:5.1f} mm deep: {push:.2f} N, {'exact' if exact else 'the nearest feasible'}")
