"""Where and how well can a rig pull? Measures of structure matrices and tension limits, and sweeps of them."""

from tensionlab.workspace.catalogue import MEASURES
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
from tensionlab.workspace.paths import box, polyline, read_poses
from tensionlab.workspace.pose_sets import Grid, PoseList
from tensionlab.workspace.questions import (
    BodyDistance,
    CableDistance,
    CapacityMargin,
    ConditionNumber,
    Effort,
    IsotropicForce,
    LeastSingularValue,
    ReachableShare,
    TensionFactor,
    WrenchClosure,
)
from tensionlab.workspace.vary import vary

__all__ = [
    "MEASURES",
    "BodyDistance",
    "CableDistance",
    "CapacityMargin",
    "Capsule",
    "Clearance",
    "ConditionNumber",
    "Effort",
    "Grid",
    "IsotropicForce",
    "LeastSingularValue",
    "PoseList",
    "ReachableShare",
    "TensionFactor",
    "WrenchClosure",
    "body_distance",
    "box",
    "cable_distance",
    "cable_pairs",
    "capacity_margin",
    "condition_number",
    "isotropic_force",
    "least_singular_value",
    "polyline",
    "read_poses",
    "segment_distance",
    "tension_factor",
    "vary",
    "wrench_closure",
]
