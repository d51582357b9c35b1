"""Where and how well can a rig pull? Measures of structure matrices and tension limits, for arrays of poses."""

from tensionlab.workspace.directions import Effort, effort, reachable_share
from tensionlab.workspace.gradient import MarginGradient, RigMarginGradient, margin_gradient, rig_margin_gradient
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
from tensionlab.workspace.wrench_set import HalfSpaces, half_spaces, vertices

__all__ = [
    "Capsule",
    "Clearance",
    "Effort",
    "HalfSpaces",
    "MarginGradient",
    "RigMarginGradient",
    "body_distance",
    "cable_distance",
    "cable_pairs",
    "capacity_margin",
    "condition_number",
    "effort",
    "half_spaces",
    "isotropic_force",
    "least_singular_value",
    "margin_gradient",
    "reachable_share",
    "rig_margin_gradient",
    "segment_distance",
    "tension_factor",
    "vertices",
    "wrench_closure",
]
