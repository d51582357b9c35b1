"""Workspace of a rig: metrics of structure matrices and tension limits, sweeps and layout search."""

from tensionlab.workspace.certification import certify
from tensionlab.workspace.certified import CertifiedWorkspace
from tensionlab.workspace.interference import body_distance, cable_distance
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.results import Layout, LayoutSearch
from tensionlab.workspace.layout.search import search_layout
from tensionlab.workspace.layout.space import Space, Surface, room
from tensionlab.workspace.metrics import METRICS, Metric, metric
from tensionlab.workspace.orientations import cone, roll_pitch_yaw
from tensionlab.workspace.poses import Grid, PoseList, box, read_poses
from tensionlab.workspace.structure_metrics import (
    feasible_direction_fraction,
    isotropic_force,
    squared_tension,
    tension_factor,
    wrench_closure,
)
from tensionlab.workspace.sweep.dataset import summary
from tensionlab.workspace.sweep.plan import vary
from tensionlab.workspace.wrench_set import (
    capacity_margin,
    half_spaces,
    loss_margins,
    margin_gradient,
    rig_margin_gradient,
    vertices,
)

__all__ = [
    "METRICS",
    "CertifiedWorkspace",
    "Grid",
    "Layout",
    "LayoutSearch",
    "Metric",
    "Objective",
    "PoseList",
    "Space",
    "Surface",
    "body_distance",
    "box",
    "cable_distance",
    "capacity_margin",
    "certify",
    "cone",
    "feasible_direction_fraction",
    "half_spaces",
    "isotropic_force",
    "loss_margins",
    "margin_gradient",
    "metric",
    "read_poses",
    "rig_margin_gradient",
    "roll_pitch_yaw",
    "room",
    "search_layout",
    "squared_tension",
    "summary",
    "tension_factor",
    "vary",
    "vertices",
    "wrench_closure",
]


def __dir__() -> list[str]:
    return sorted(__all__)
