"""Allocate many forces at many positions in one call: leading axes broadcast."""

import numpy as np

import tensionlab as tl
from tensionlab.model.directions import fibonacci

rig = tl.load_rig("bartels2026-validation")
positions = rig.home + np.linspace([-0.2, 0.0, 0.0], [0.2, 0.6, 0.0], 50)[:, None]  # (50, 1, 3)
forces = 1.5 * fibonacci(200)  # (200, 3)

result = rig.allocate(forces, positions)  # (50, 200)
print(result)
print(f"{result.exact.mean():.1%} of the forces are feasible")
print(result.to_pandas().head())
