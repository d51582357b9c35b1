"""Where and how well can a rig pull? Measures of structure matrices and tension limits, and sweeps of them."""

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
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.result import Layout, LayoutSearch
from tensionlab.workspace.layout.search import search_layout
from tensionlab.workspace.layout.space import Space, Surface, room
from tensionlab.workspace.margin import capacity_margin
from tensionlab.workspace.metrics import (
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
)
from tensionlab.workspace.paths import box, polyline, read_poses
from tensionlab.workspace.registry import MEASURES
from tensionlab.workspace.structure_metrics import (
    condition_number,
    isotropic_force,
    least_singular_value,
    tension_factor,
    wrench_closure,
)
from tensionlab.workspace.sweep.configurations import vary
from tensionlab.workspace.sweep.pose_sets import Grid, PoseList
from tensionlab.workspace.wrench_set import HalfSpaces, half_spaces, vertices

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
    "body_distance",
    "box",
    "cable_distance",
    "cable_pairs",
    "capacity_margin",
    "condition_number",
    "effort",
    "half_spaces",
    "isotropic_force",
    "least_singular_value",
    "margin_gradient",
    "polyline",
    "reachable_share",
    "read_poses",
    "rig_margin_gradient",
    "room",
    "search_layout",
    "segment_distance",
    "tension_factor",
    "vary",
    "vertices",
    "wrench_closure",
]
