"""Where and how well can a rig pull? Measures of structure matrices and tension limits, for arrays of poses."""

from tensionlab.workspace.interference import (
    Capsule,
    Clearance,
    body_distance,
    cable_distance,
    cable_pairs,
    segment_distance,
)
from tensionlab.workspace.margin import capacity_margin
from tensionlab.workspace.measures import (
    condition_number,
    isotropic_force,
    least_singular_value,
    tension_factor,
    wrench_closure,
)

__all__ = [
    "Capsule",
    "Clearance",
    "body_distance",
    "cable_distance",
    "cable_pairs",
    "capacity_margin",
    "condition_number",
    "isotropic_force",
    "least_singular_value",
    "segment_distance",
    "tension_factor",
    "wrench_closure",
]
