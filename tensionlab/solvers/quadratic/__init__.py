"""Quadratic programs: the solver `QuadraticProgram`, its backends, and the same program left plain."""

from tensionlab.solvers.quadratic.backends import BACKENDS, installed_backends
from tensionlab.solvers.quadratic.plain import TIGHT, PlainProgram, solve_qp
from tensionlab.solvers.quadratic.programs import QuadraticProgram

__all__ = ["BACKENDS", "TIGHT", "PlainProgram", "QuadraticProgram", "installed_backends", "solve_qp"]
