"""Choose the cable tensions that render one force, and read what is proved about them."""

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")  # four modules around a hand, 0.5 to 6 N each
result = rig.allocate([1.0, 0.5, 1.0])  # a force in N, with the hand at the rig's home

for module, tension in zip(rig.modules, result.tensions, strict=True):
    print(f"{module.name:10} {tension:.3f} N")
print("exact:", bool(result.exact))
