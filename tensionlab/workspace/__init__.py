"""Workspace of a rig: metrics of structure matrices and tension limits, sweeps and layout search."""

from tensionlab.workspace.certification.certify import certify
from tensionlab.workspace.certification.result import Bounds, CertifiedWorkspace
from tensionlab.workspace.interference import (
    Capsule,
    Clearance,
    body_distance,
    cable_distance,
    cable_pairs,
    segment_distance,
)
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.results import Layout, LayoutSearch
from tensionlab.workspace.layout.search import search_layout
from tensionlab.workspace.layout.space import Space, Surface, room
from tensionlab.workspace.margin import (
    MarginGradient,
    RigMarginGradient,
    capacity_margin,
    margin_gradient,
    rig_margin_gradient,
)
from tensionlab.workspace.metrics import (
    METRICS,
    BodyDistance,
    CableDistance,
    CapacityMargin,
    ConditionNumber,
    IsotropicForce,
    LeastSingularValue,
    ReachableShare,
    SquaredTension,
    TensionFactor,
    WrenchClosure,
    WrenchFeasible,
)
from tensionlab.workspace.orientations import cone, over_orientations, roll_pitch_yaw
from tensionlab.workspace.poses import Grid, PoseList, box, polyline, read_poses
from tensionlab.workspace.structure_metrics import (
    Effort,
    condition_number,
    effort,
    isotropic_force,
    least_singular_value,
    reachable_share,
    tension_factor,
    wrench_closure,
)
from tensionlab.workspace.sweep.dataset import summary
from tensionlab.workspace.sweep.plan import vary
from tensionlab.workspace.wrench_set import HalfSpaces, half_spaces, vertices

__all__ = [
    "METRICS",
    "BodyDistance",
    "Bounds",
    "CableDistance",
    "CapacityMargin",
    "Capsule",
    "CertifiedWorkspace",
    "Clearance",
    "ConditionNumber",
    "Effort",
    "Grid",
    "HalfSpaces",
    "IsotropicForce",
    "Layout",
    "LayoutSearch",
    "LeastSingularValue",
    "MarginGradient",
    "Objective",
    "PoseList",
    "ReachableShare",
    "RigMarginGradient",
    "Space",
    "SquaredTension",
    "Surface",
    "TensionFactor",
    "WrenchClosure",
    "WrenchFeasible",
    "body_distance",
    "box",
    "cable_distance",
    "cable_pairs",
    "capacity_margin",
    "certify",
    "condition_number",
    "cone",
    "effort",
    "half_spaces",
    "isotropic_force",
    "least_singular_value",
    "margin_gradient",
    "over_orientations",
    "polyline",
    "reachable_share",
    "read_poses",
    "rig_margin_gradient",
    "roll_pitch_yaw",
    "room",
    "search_layout",
    "segment_distance",
    "summary",
    "tension_factor",
    "vary",
    "vertices",
    "wrench_closure",
]


def __dir__() -> list[str]:
    return sorted(__all__)
