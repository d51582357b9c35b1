"""Tension allocation for modular cable systems: every solver behind one interface, every answer proved."""

from tensionlab.allocation import Allocation, Allocator, allocate
from tensionlab.errors import (
    MissingDependency,
    RigError,
    ShapeError,
    TensionlabError,
    UnknownSolver,
    Unreachable,
)
from tensionlab.solvers import SOLVERS, Status
