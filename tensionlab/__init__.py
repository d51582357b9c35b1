"""Tension allocation for modular cable systems: every solver behind one interface, every answer proved.

Each name is imported where it is first used: `tensionlab estop` waits for no solver, and ``python -m tensionlab``
imports nothing else before it has taken the working directory off its path.
"""

from tensionlab.support.lazy import importer

TYPE_CHECKING = False  # as in `typing`, which is not imported for it
if TYPE_CHECKING:
    from tensionlab import benchmark, datasets, errors, hardware, plots, solvers, workspace
    from tensionlab.allocation import Allocation, Allocator, allocate
    from tensionlab.benchmark.comparison import compare
    from tensionlab.gradients import AllocationGradients, AllocationJacobian, allocation_jacobian
    from tensionlab.model.bodies import Body, person
    from tensionlab.model.files import load_requirement, load_rig, save_rig
    from tensionlab.model.kinematics import PoseEstimate
    from tensionlab.model.layouts import alternate_corners, box_corners, ring_plus_top
    from tensionlab.model.module import Module, Platform, TensionLimits
    from tensionlab.model.pose import CoordinateFrame, RestPose
    from tensionlab.model.requirement import Requirement
    from tensionlab.model.rig import Rig
    from tensionlab.model.stiffness import natural_frequencies, stiffness_eigenvalues, stiffness_matrix
    from tensionlab.path_allocation import PathAllocation, RateLimitedAllocator, allocate_path
    from tensionlab.plots import plot
    from tensionlab.solvers import SOLVERS, Solver, Status
    from tensionlab.stiffest import StiffestTensions, stiffest_tensions
    from tensionlab.support.files.reading import get_include
    from tensionlab.trajectory import Trajectory, inverse_dynamics, read_trajectory
    from tensionlab.viewer.design_page import view
    from tensionlab.workspace.sweep import sweep

__version__ = "1.0.0"

__all__ = [
    "SOLVERS",
    "Allocation",
    "AllocationGradients",
    "AllocationJacobian",
    "Allocator",
    "Body",
    "CoordinateFrame",
    "Module",
    "PathAllocation",
    "Platform",
    "PoseEstimate",
    "RateLimitedAllocator",
    "Requirement",
    "RestPose",
    "Rig",
    "Solver",
    "Status",
    "StiffestTensions",
    "TensionLimits",
    "Trajectory",
    "allocate",
    "allocate_path",
    "allocation_jacobian",
    "alternate_corners",
    "benchmark",
    "box_corners",
    "compare",
    "datasets",
    "errors",
    "get_include",
    "hardware",
    "inverse_dynamics",
    "load_requirement",
    "load_rig",
    "natural_frequencies",
    "person",
    "plot",
    "plots",
    "read_trajectory",
    "ring_plus_top",
    "save_rig",
    "solvers",
    "stiffest_tensions",
    "stiffness_eigenvalues",
    "stiffness_matrix",
    "sweep",
    "view",
    "workspace",
]

_NAMES = {
    "tensionlab.allocation": ("Allocation", "Allocator", "allocate"),
    "tensionlab.benchmark.comparison": ("compare",),
    "tensionlab.gradients": ("AllocationGradients", "AllocationJacobian", "allocation_jacobian"),
    "tensionlab.model.bodies": ("Body", "person"),
    "tensionlab.model.files": ("load_requirement", "load_rig", "save_rig"),
    "tensionlab.model.kinematics": ("PoseEstimate",),
    "tensionlab.model.layouts": ("alternate_corners", "box_corners", "ring_plus_top"),
    "tensionlab.model.module": ("Module", "Platform", "TensionLimits"),
    "tensionlab.model.pose": ("CoordinateFrame", "RestPose"),
    "tensionlab.model.requirement": ("Requirement",),
    "tensionlab.model.rig": ("Rig",),
    "tensionlab.model.stiffness": ("natural_frequencies", "stiffness_eigenvalues", "stiffness_matrix"),
    "tensionlab.path_allocation": ("PathAllocation", "RateLimitedAllocator", "allocate_path"),
    "tensionlab.solvers": ("SOLVERS", "Solver", "Status"),
    "tensionlab.stiffest": ("StiffestTensions", "stiffest_tensions"),
    "tensionlab.support.files.reading": ("get_include",),
    "tensionlab.trajectory": ("Trajectory", "inverse_dynamics", "read_trajectory"),
    "tensionlab.workspace.sweep": ("sweep",),
    "tensionlab.plots": ("plot",),
    "tensionlab.viewer.design_page": ("view",),
}


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


if not TYPE_CHECKING:
    __getattr__ = importer(__name__, _NAMES)
