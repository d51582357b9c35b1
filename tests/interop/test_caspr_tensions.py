"""Tensions that CASPR published for the planar robot of K. N. Toosi University.

Figure 5 of Lau, Eden, Tan and Oetomo, "CASPR: A comprehensive cable-robot analysis and simulation platform for
the research of cable-driven parallel robots", IROS 2016, in its repository: docs/papers/16_IROS_CASPR.pdf. It is a
vector drawing, with a corner of each curve every 10 ms; `tests/data/caspr_2016_figure_5.csv` has them in units of
the axes. The drawing has its coordinates to 0.4 mN, the file to 1 mN.
"""

import csv
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl

FIGURE = Path(__file__).parents[1] / "data" / "caspr_2016_figure_5.csv"
# x, y in m and the angle in rad; from rest to rest in 1 s, by a spline of degree 5.
START, END = np.array([0.3, 0.8, 0.1]), np.array([0.7, 0.2, -0.2])
WITHIN_N = 1e-3


def read_figure():
    """Times and tensions by solver and cable."""
    found = defaultdict(list)
    with FIGURE.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found[row["solver"], int(row["cable"])].append((float(row["time_s"]), float(row["tension_N"])))
    return {key: np.array(points).T for key, points in found.items()}


@pytest.mark.parametrize(
    ("published", "solver"),
    [("two-norm", "newton"), ("two-norm", "minimax"), ("improved-closed-form", "closed-form")],
)
def test_tensions_are_those_of_caspr(published, solver):
    rig = tl.load_rig("kntu-planar")
    curves = {cable: curve for (name, cable), curve in read_figure().items() if name == published}
    assert set(curves) == {1, 2, 3, 4}
    for cable, (t, tensions) in curves.items():
        assert len(t) > 50
        poses = START + np.outer(10 * t**3 - 15 * t**4 + 6 * t**5, END - START)
        accelerations = np.outer(60 * t - 180 * t**2 + 120 * t**3, END - START)
        structure = rig.structure_matrix(poses[:, :2], poses[:, 2])
        wrenches = accelerations * [rig.platform.mass, rig.platform.mass, rig.platform.inertia[0, 0]]
        found = tl.allocate(structure, wrenches, rig.limits, solver)
        assert (found.status == tl.Status.EXACT).all()
        np.testing.assert_allclose(found.tensions[:, cable - 1], tensions, rtol=0, atol=WITHIN_N)
