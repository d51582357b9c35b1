"""Differentiate the tensions with respect to the desired force, and check the derivative by differences."""

import numpy as np

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")
structure, desired = rig.structure_matrix(rig.home), np.array([1.0, 0.5, 1.0])
jacobian = tl.allocation_jacobian(structure, desired, rig.limits).wrench  # (cables, components)

step = 1e-6 * np.eye(3)
ahead, behind = (tl.allocate(structure, desired + sign * step, rig.limits).tensions for sign in (1, -1))
differences = ((ahead - behind) / 2e-6).T
print(jacobian.round(3))
print(f"largest difference: {abs(jacobian - differences).max():.1e}")
