"""Solvers: arrays in, tensions out. One file a family; `base` has the contract, `registry` the names."""

from tensionlab.solvers.base import Answer, Policy, Problem, Solver, Status
from tensionlab.solvers.closed_form import ImprovedClosedForm, Polygon, Pseudoinverse, Puncture
from tensionlab.solvers.convex import ConvexProgram
from tensionlab.solvers.least_squares import Dykstra, Newton
from tensionlab.solvers.linear_program import LeastSum, Minimax, OptimallySafe
from tensionlab.solvers.penalty import AnalyticCentre, SlackNorm, Spidar
from tensionlab.solvers.quadratic import QuadraticProgram
from tensionlab.solvers.registry import (
    SOLVERS,
    Selected,
    as_fused_solver,
    every_solver,
    find_plugins,
    is_built_in,
    make,
    name_solvers,
    offered_plugins,
    select_solvers,
    title_of,
)

__all__ = [
    "SOLVERS", "AnalyticCentre", "Answer", "ConvexProgram", "Dykstra", "ImprovedClosedForm", "LeastSum",
    "Minimax", "Newton", "OptimallySafe", "Policy", "Polygon", "Problem", "Pseudoinverse", "Puncture",
    "QuadraticProgram", "Selected", "SlackNorm", "Solver", "Spidar", "Status", "as_fused_solver",
    "every_solver", "find_plugins", "is_built_in", "make", "name_solvers", "offered_plugins", "select_solvers",
    "title_of",
]  # fmt: skip
