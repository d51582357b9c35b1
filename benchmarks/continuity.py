"""Jumps of solvers along random segments in committed rigs: ``python -m benchmarks.continuity``."""

from __future__ import annotations

import sys

import numpy as np

from tensionlab.allocation import Allocator
from tensionlab.benchmark.continuity import measure_continuity, path_of
from tensionlab.benchmark.rigs import desired_wrenches, unit_vectors
from tensionlab.errors import InputError
from tensionlab.model.files import load_rig
from tensionlab.support.formatting import format_number
from tensionlab.support.table import Column, Table

RIGS = ("cogiro", "caroca", "ipanema-1", "bartels2026-validation", "cube-8", "seven-modules")
SEGMENTS, SAMPLES = 40, 101  # of each rig
REACH = 0.35  # of the half distance between the outermost anchors, from home
PUSH = 0.05  # force beside the weight, of the largest tension
ENTRIES = (
    ("newton", "force"),
    ("newton", "tension"),
    ("newton", "direction"),
    ("dykstra", None),
    ("qp:daqp", "force"),
    ("least-sum", None),
    ("minimax", None),
    ("safe", None),
    ("polygon:centroid", None),
    ("puncture", None),
    ("closed-form", None),
    ("pseudoinverse:middle", None),
    ("analytic-centre", None),
)


def measure(name: str, segments: int = SEGMENTS) -> list[list[object]]:
    """Return a row for each solver: its largest jumps and step on random segments of a rig."""
    rig, rng = load_rig(name), np.random.default_rng(39)
    half = REACH * np.ptp(rig.anchors, axis=0) / 2.0
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    paths = []
    for _ in range(segments):
        start, end = rig.home + half * rng.uniform(-1.0, 1.0, size=(2, 3))
        forces = PUSH * float(rig.limits.upper.max()) * unit_vectors(rng, 2, 3)
        wrenches = desired_wrenches(rig, forces[0] + share * (forces[1] - forces[0]))
        paths.append(path_of(rig, start + share * (end - start), None, wrenches))
    rows: list[list[object]] = []
    samples = np.arange(float(SAMPLES))
    for solver, policy in ENTRIES:
        try:
            allocator = Allocator(rig.limits, solver, policy=policy)  # type: ignore[arg-type]  # it checks them
            found = np.array([measure_continuity(allocator, path, allocator(*path(samples))) for path in paths])
        except InputError:  # it does not support the rig
            continue
        rows.append([name, solver, policy, int((found[:, 0] > 0.0).sum()), *found.max(axis=0)])
    return rows


def main() -> None:
    """Print jumps and steps of all solvers on all rigs, or those named."""
    columns = ["rig", "solver", "policy", "segments with a jump",
               *(Column(name, "N", format_number) for name in ("jump", "beyond", "step"))]  # fmt: skip
    rows = [row for name in sys.argv[1:] or RIGS for row in measure(name)]
    print(Table(columns, rows, f"{SEGMENTS} segments of {SAMPLES} samples in each rig"))


if __name__ == "__main__":
    main()
