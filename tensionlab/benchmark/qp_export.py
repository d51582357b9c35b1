"""A problem set as a table of quadratic programs, for benchmarks of QP solvers."""

from __future__ import annotations

from typing import Any

import numpy as np

from tensionlab.benchmark.problem_sets import ProblemSet


def qp_rows(problems: ProblemSet) -> list[dict[str, Any]]:
    """Which quadratic programs are these problems?

    Each is ``minimise x'Px/2 + q'x subject to Ax = b, lb <= x <= ub`` of the tensions x, so that P is the
    identity, q zero, A the structure matrix, b the wrench. In the columns that qpbenchmark's `ParquetTestSet`
    reads: matrices row by row in one list, G and h None because there are no other inequalities.

    Returns
    -------
    list of dict
        One for each problem: ``name`` (set, group and row: unique within the set), ``P``, ``q``, ``G``, ``h``,
        ``A``, ``b``, ``lb``, ``ub``, and for readers that know the set ``group`` and ``path_mm`` (None where
        the problems have no order).
    """
    rows: list[dict[str, Any]] = []
    for group in problems.groups:
        size, _, m = group.structure.shape
        lower, upper = (np.broadcast_to(each, (size, m)) for each in (group.lower, group.upper))
        identity, zeros = np.eye(m).ravel(), np.zeros(m)
        rows += [
            {
                "name": f"{problems.name}/{group.label}/{row}",
                "P": identity,
                "q": zeros,
                "G": None,
                "h": None,
                "A": group.structure[row].ravel(),
                "b": group.wrench[row],
                "lb": lower[row],
                "ub": upper[row],
                "group": group.label,
                "path_mm": None if group.path_mm is None else float(group.path_mm[row]),
            }
            for row in range(size)
        ]
    return rows
