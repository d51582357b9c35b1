"""Sweep a rig over positions: the largest force that it renders in every direction."""

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")
positions = tl.workspace.box((-0.6, 0.6), (0.0, 2.2), (-0.6, 0.6), step=0.1)
data = tl.sweep(rig, positions, ["capacity-margin", "condition-number"])  # an xarray.Dataset

margin = data["capacity-margin"].squeeze()
best = margin[margin.argmax(...)]
print(f"{best.item():.2f} N at x, y, z = {', '.join(f'{best[axis].item():.1f}' for axis in 'xyz')} m")
print(tl.workspace.summary(data))
