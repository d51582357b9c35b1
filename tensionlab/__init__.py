"""Tension allocation for modular cable systems: every solver behind one interface, every answer proved."""

import importlib
from typing import TYPE_CHECKING

from tensionlab import datasets, workspace
from tensionlab.allocation import Allocation, Allocator, allocate
from tensionlab.benchmarking.run import benchmark
from tensionlab.comparison.compare import compare
from tensionlab.errors import (
    DataError,
    InputError,
    MissingDependency,
    PluginError,
    RigError,
    ShapeError,
    SweepError,
    TensionlabError,
    UnknownSolver,
    Unreachable,
)
from tensionlab.jacobian import AllocationGradients, AllocationJacobian, allocation_jacobian
from tensionlab.model.files import load_requirement, load_rig, save_rig
from tensionlab.model.kinematics import PoseEstimate
from tensionlab.model.layouts import alternate_corners, box_corners, ring_plus_top
from tensionlab.model.module import Module, Platform, TensionLimits
from tensionlab.model.pose import Frame, RestPose
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.solvers import SOLVERS, Solver, Status
from tensionlab.solvers.closed_form import ClosedForm, Polygon, Pseudoinverse, Puncture
from tensionlab.solvers.convex import ConvexProgram
from tensionlab.solvers.least_squares import Dykstra, Newton
from tensionlab.solvers.linear_program import LeastSum, Minimax, OptimallySafe
from tensionlab.solvers.penalty import AnalyticCentre, SlackNorm, Spidar
from tensionlab.solvers.quadratic import QuadraticProgram
from tensionlab.workspace.sweep import sweep

if TYPE_CHECKING:
    from tensionlab import plots
    from tensionlab.plots import plot

__version__ = "0.1.0"

__all__ = [
    "SOLVERS",
    "Allocation",
    "AllocationGradients",
    "AllocationJacobian",
    "Allocator",
    "AnalyticCentre",
    "ClosedForm",
    "ConvexProgram",
    "DataError",
    "Dykstra",
    "Frame",
    "InputError",
    "LeastSum",
    "Minimax",
    "MissingDependency",
    "Module",
    "Newton",
    "OptimallySafe",
    "Platform",
    "PluginError",
    "Polygon",
    "PoseEstimate",
    "Pseudoinverse",
    "Puncture",
    "QuadraticProgram",
    "Requirement",
    "RestPose",
    "Rig",
    "RigError",
    "ShapeError",
    "SlackNorm",
    "Solver",
    "Spidar",
    "Status",
    "SweepError",
    "TensionLimits",
    "TensionlabError",
    "UnknownSolver",
    "Unreachable",
    "allocate",
    "allocation_jacobian",
    "alternate_corners",
    "benchmark",
    "box_corners",
    "compare",
    "datasets",
    "load_requirement",
    "load_rig",
    "plot",
    "plots",
    "ring_plus_top",
    "save_rig",
    "sweep",
    "workspace",
]


def __dir__() -> list[str]:
    return sorted(__all__)


if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import the plots where they are first used: they know all results, and take longer than all the rest."""
        if name in ("plot", "plots"):
            plots = importlib.import_module("tensionlab.plots")
            return plots if name == "plots" else plots.plot
        raise AttributeError(f"module 'tensionlab' has no attribute {name!r}")
