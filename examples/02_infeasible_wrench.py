"""Ask for a force that no tensions render: three policies, and the certificate that none exists."""

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")
structure = rig.structure_matrix(rig.home)
desired = [6.0, 3.0, 1.0]

for policy in ("force", "tension", "direction"):
    result = tl.allocate(structure, desired, rig.limits, policy=policy)
    print(f"{policy:10} renders {result.wrench.round(2)} N")

# Along `separation`, the desired force exceeds what any tensions inside the limits reach.
direction = result.separation
reached = (direction @ structure * [rig.limits.lower, rig.limits.upper]).max(axis=0).sum()
print(f"certified: {direction @ desired:.2f} > {reached:.2f}")
