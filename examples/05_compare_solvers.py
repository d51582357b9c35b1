"""Compare solvers on the same forces: feasibility found, error, time."""

import tensionlab as tl

rig = tl.load_rig("bartels2026-validation")
found = tl.compare(rig, solvers=["newton", "dykstra", "closed-form", "least-sum"], magnitude=1.5)
print(found.table().to_text())
