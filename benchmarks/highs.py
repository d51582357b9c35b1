"""Feasibility of wrenches by HiGHS, one linear program for each pose: a reference for metrics.

Called directly, without SciPy's checks, which take more time than the simplex steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from tensionlab.errors import optional_import
from tensionlab.support.arrays import Floats


def model(structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
    """Return the linear program of tensions inside the limits that render the wrench.

    Parameters
    ----------
    structure : (n, m) array
    wrench : (n,) array
    lower, upper : (m,) arrays
        In N; infinity is no limit.

    Returns
    -------
    highspy.HighsLp
    """
    highspy = _load()
    n, m = structure.shape
    program = highspy.HighsLp()
    program.num_col_, program.num_row_ = m, n
    program.col_cost_ = np.zeros(m)
    program.col_lower_, program.col_upper_ = lower, upper
    program.row_lower_ = program.row_upper_ = wrench
    program.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    program.a_matrix_.start_ = np.arange(0, n * m + 1, n)
    program.a_matrix_.index_ = np.tile(np.arange(n), m)
    program.a_matrix_.value_ = structure.T.ravel()
    return program


def feasibility_checker() -> Callable[[Iterable[Any]], list[bool]]:
    """Return a function that tells which models have a solution, by HiGHS's simplex without presolve."""
    highspy = _load()
    solver = highspy.Highs()
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("presolve", "off")

    def feasible(models: Iterable[Any]) -> list[bool]:
        found = []
        for each in models:
            solver.passModel(each)
            solver.run()
            found.append(solver.getModelStatus() == highspy.HighsModelStatus.kOptimal)
        return found

    return feasible


def _load() -> Any:
    with optional_import("solvers", "HiGHS"):
        import highspy
    return highspy
