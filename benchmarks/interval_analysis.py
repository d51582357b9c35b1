"""Proved workspaces compared with interval analysis: ``python -m benchmarks.interval_analysis``.

Gouttefarde, Daney and Merlet, "Interval-analysis-based determination of the wrench-feasible workspace of parallel
cable-driven robots", 2011, give a cell of poses an interval for each entry of the structure matrix. The cell is
inside if every matrix in the intervals renders all that is required, outside if none renders some of it. Here the
intervals are as narrow as can be, of a point's cables; and whether all matrices do is asked at the corners at
which the set of wrenches is smallest, one for each choice of signs (Rohn, 1981, for systems of intervals). So
what is left undecided is due to the intervals alone.

Both cut the same cells in two down to the same resolution. The table has the bounds of the workspace, how far
apart they are, the cells that were looked at, and seconds of all processors together.
"""

from __future__ import annotations

import argparse
import itertools
import time

import numpy as np

from benchmarks.certify import Case, cases
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace import capacity_margin, half_spaces
from tensionlab.workspace.certified import Bounds, subdivide

CASES = ("published rig, 1 N", "published rig, 0.5 N", "two cables, a weight")
CHUNK_CELLS = 20_000


def main() -> None:
    """Print the table; exit status 1 if the two contradict each other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resolution", type=float, default=0.02, help="longest edge of the finest cells, in m")
    resolution = parser.parse_args().resolution
    print(f"{'':22} {'bounds of the workspace':>29} {'apart':>7} {'cells':>10} {'s':>6}")
    contradicted = False
    for case in (each for each in cases() if each.name in CASES):
        began = time.process_time()
        volume, cells = prove_by_intervals(case, resolution)
        between = time.process_time()
        proved = Case(case.name, case.rig, case.region, case.required, resolution).prove()
        ended = time.process_time()
        print(case.name)
        show("interval analysis", volume, cells, between - began)
        show("tensionlab", proved.volume, proved.evaluations, ended - between)
        contradicted |= proved.volume.lower > volume.upper or volume.lower > proved.volume.upper
    raise SystemExit(int(contradicted))


def show(name: str, volume: Bounds, cells: int, seconds: float) -> None:
    """Print a line of the table."""
    apart = 100 * (volume.upper - volume.lower) / volume.upper
    print(f"  {name:20} {volume.describe(5):>29} {apart:6.2f}% {cells:10,d} {seconds:6.1f}")


def prove_by_intervals(case: Case, resolution: float) -> tuple[Bounds, int]:
    """Return bounds of the workspace of a point rig, in m² or m³, and how many cells were looked at."""
    cells = subdivide(case.region, resolution, case.rig.dimension)
    places, inside, outside, looked = cells.first(), 0.0, 0.0, 0
    for level in range(cells.levels + 1):
        edges, left = cells.edges(level), []
        for start in range(0, len(places), CHUNK_CELLS):
            part = places[start : start + CHUNK_CELLS]
            verdict = judge(case, cells.centres(level, part), edges / 2)
            inside += float(cells.cell_volume(level)) * np.count_nonzero(verdict == 1)
            outside += float(cells.cell_volume(level)) * np.count_nonzero(verdict == -1)
            left.append(part[verdict == 0])
        looked += len(places)
        if level < cells.levels:
            places = cells.children(np.concatenate(left))
    return Bounds(inside, cells.volume - outside), looked


def judge(case: Case, centres: Floats, half: Floats) -> Floats:
    """Return 1 for the cells (k, d) that are inside, -1 for those that are outside, 0 for the others."""
    rig, required = case.rig, case.required
    assert required is not None
    wrench, ball = required.middle(rig, None), required.ball
    low, high = directions(rig, centres, half)
    middle, reach = (low + high) / 2, (high - low) / 2
    inside = np.ones(len(centres), dtype=bool)
    for signs in itertools.product((-1.0, 1.0), repeat=rig.dimension):
        smallest = middle - np.array(signs)[:, None] * reach
        inside &= capacity_margin(smallest, rig.limits, (wrench, ball)) >= 0
    # Outside: in the direction in which most is missing in the middle, even the most that intervals allow is less.
    normals, offsets = half_spaces(middle, rig.limits)
    excess = normals @ wrench + ball - offsets
    worst = normals[np.arange(len(normals)), excess.argmax(axis=-1)]
    along = np.einsum("kd,kdm->km", worst, middle) + np.einsum("kd,kdm->km", np.abs(worst), reach)
    most = np.maximum(along * rig.limits.lower, along * rig.limits.upper).sum(axis=-1)
    outside = most < worst @ wrench + ball
    return np.where(inside, 1.0, np.where(outside, -1.0, 0.0))


def directions(rig: Rig, centres: Floats, half: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest of every entry of the structure matrix (k, d, m), over each cell.

    A component of a unit vector grows with its own coordinate; its magnitude falls with those of the others.
    """
    vector = np.swapaxes(rig.anchors - centres[:, None, :], 1, 2)
    low, high = vector - half[:, None], vector + half[:, None]
    farthest = np.maximum(low**2, high**2)
    nearest = np.where((low < 0) & (high > 0), 0.0, np.minimum(low**2, high**2))
    far, near = (each.sum(axis=1, keepdims=True) - each for each in (farthest, nearest))

    def component(coordinate: Floats, largest: bool) -> Floats:
        others = np.where((coordinate > 0) == largest, near, far)
        length = np.sqrt(coordinate**2 + others)
        return np.asarray(coordinate / np.where(length > 0, length, 1.0))

    return component(low, False), component(high, True)


if __name__ == "__main__":
    main()
