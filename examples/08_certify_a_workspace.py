"""Prove a workspace, including all positions between the points of a grid."""

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")
region = [(-0.3, 0.6), (0.0, 2.3), (-0.5, 0.5)]  # x, y, z in m
ball = ([0.0, 0.0, 0.0], 1.0)  # every force up to 1 N

proved = tl.workspace.certify(rig, region, ball, resolution=0.05)
attributes = proved.to_xarray().attrs
print(f"volume: {attributes['volume_lower']:.3f} to {attributes['volume_upper']:.3f} {attributes['volume_unit']}")
print("inside, outside:", proved.at([[0.0, 0.3, 0.0], [0.3, 1.5, 0.0]]))
