"""Proved workspaces of rigs whose workspace is known, and random poses held against what is proved.

`python -m benchmarks.certify` proves the published rig at 1 N and 0.5 N, wrench closure of IPAnema 2, areas that
are known in closed form, where CoGiRo holds its weight at all orientations within 1° and 5°, and a rig with a hole
that no grid would see; then a million random poses in proved cells are held against the capacity margin or the
null space of each pose. Within an angle, the worst orientation of each position is sought. Exit status 1 if one
contradicts, or a known area is not within its bounds. Seconds are those of all processors together, so that a
busy machine counts little.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.model.files import load_rig
from tensionlab.model.kinematics import exponential
from tensionlab.model.module import Module
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace import CertifiedWorkspace, certify, wrench_closure
from tensionlab.workspace.certification import WRENCH_CLOSURE
from tensionlab.workspace.wrench_set import required_margin

POSES = 1_000_000
CHUNK_POSES = 100_000
UNIT_SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
TETRAHEDRON = ((-0.6, 0.6), (0.0, 2.3), (-0.6, 0.6))  # around the anchors of the published rig
SEARCH_STEPS = (
    *[100.0] * 10,
    *(0.8**k for k in range(30)),
)  # of turns, in angles; the first end at the full angle
STRENGTH_RATIO = 1.5  # of the tension limit of two cables to the weight that they hold


@dataclass(frozen=True)
class Case:
    """Workspace to prove, at all orientations within an angle; ``volume`` is NaN where it is unknown."""

    name: str
    rig: Rig
    region: ArrayLike
    required: Requirement | None
    resolution: float
    volume: float = float("nan")
    angle_deg: float = 0.0

    def prove(self) -> CertifiedWorkspace:
        """Prove it: wrench closure where nothing is required."""
        angle = np.radians(self.angle_deg)
        return certify(self.rig, self.region, self.required or WRENCH_CLOSURE, self.resolution, angle=angle)

    def holds(self, positions: Floats) -> np.ndarray:
        """Return whether the rig renders what is required at positions (k, d), by the metrics of single poses."""
        if self.required is not None and self.angle_deg:
            rng, angle = np.random.default_rng(0), np.radians(self.angle_deg)
            return least_margins(self.rig, self.required, positions, angle, rng) >= 0
        structure = self.rig.structure_matrix(positions)
        if self.required is None:
            return np.asarray(wrench_closure(structure))
        return required_margin(self.rig, structure, self.required) >= 0


def least_margins(
    rig: Rig, required: Requirement, positions: Floats, angle: float, rng: np.random.Generator
) -> Floats:
    """Return the least margins (k,) found at positions (k, d) over turns from home, random and then close by."""

    def margins(turns: Floats) -> Floats:
        rotations = turns[:, 0] if rig.dimension == 2 else exponential(turns) @ rig.home_matrix
        return required_margin(rig, rig.structure_matrix(positions, rotations), required, rotations)

    worst = np.zeros((len(positions), rig.n - rig.dimension))
    least = margins(worst)
    for step in SEARCH_STEPS:
        tried = worst + step * angle * rng.normal(size=worst.shape)
        tried *= np.minimum(1.0, angle / np.linalg.norm(tried, axis=1, keepdims=True))
        margin = margins(tried)
        lower = margin < least
        worst[lower], least[lower] = tried[lower], margin[lower]
    return least


def planar_point(anchors: ArrayLike, upper: float = 1.0) -> Rig:
    """Return a rig of a point in the plane, without lower limits."""
    modules = tuple(Module(f"m{i}", anchor, 0.0, upper) for i, anchor in enumerate(np.asarray(anchors, float)))
    return Rig("planar", "planar-point", modules, home=np.mean(np.asarray(anchors, float), axis=0))


def area_of_two_cables(ratio: float) -> float:
    """Return the area of the unit square in which two cables from its upper corners hold a weight.

    ``ratio`` is that of their limits to the weight, at least 1. At the height z under the corners, and x from the
    left one, its tension is weight (1 - x) sqrt(x² + z²) / z: so z is at least
    x (1 - x) / sqrt(ratio² - (1 - x)²), or as much with 1 - x for x where that is more.
    """

    def primitive(s: float) -> float:  # of s (1 - s) / sqrt(ratio² - s²)
        root = float(np.sqrt(ratio**2 - s**2))
        return float(-root - ratio**2 / 2 * np.arcsin(s / ratio) + s / 2 * root)

    return 1 - 2 * (primitive(1.0) - primitive(0.5))


def planar_platform_with_a_hole() -> tuple[Rig, Floats]:
    """Return a rig, and where its margin about a weight has a minimum that rises by 1.6 µN within 1 mm of it."""
    anchors = [[-0.9, -1.05], [0.76, 0.36], [-0.31, -0.39], [0.09, 0.89], [-0.9, -0.03]]
    arms = [[0.24, 0.16], [0.22, 0.19], [-0.09, -0.2], [-0.12, 0.14], [0.05, 0.19]]
    modules = tuple(
        Module(f"m{i}", np.array(anchor), 0.5, 6.0, attachment=np.array(arm))
        for i, (anchor, arm) in enumerate(zip(anchors, arms, strict=True))
    )
    return Rig("hole", "planar", modules, home=np.mean(anchors, axis=0)), np.array([-0.0382276, -0.3745667])


def hole_requirement(more: float) -> Requirement:
    """Return a weight with the ball that the rig with a hole has at the hole, and so much more, in N."""
    rig, place = planar_platform_with_a_hole()
    weight = np.array([0.0, 3.0, 0.0])
    least = float(required_margin(rig, rig.structure_matrix(place), Requirement(weight, length=0.2)))
    return Requirement(weight, ball=least + more, length=0.2)


def cases() -> list[Case]:
    """Return what is proved."""
    published, ipanema, cogiro = (load_rig(name) for name in ("bartels2026-validation", "ipanema-2", "cogiro"))
    square, triangle = planar_point(UNIT_SQUARE), planar_point([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    hung = planar_point([(0.0, 1.0), (1.0, 1.0)], STRENGTH_RATIO)
    plane = ((-0.3, 1.2), (-0.1, 1.4))
    holed, place = planar_platform_with_a_hole()
    around = np.stack([place - 0.03, place + 0.03], axis=1)
    return [
        Case("published rig, 1 N", published, TETRAHEDRON, Requirement(ball=1.0), 0.01),
        Case("published rig, 0.5 N", published, TETRAHEDRON, Requirement(ball=0.5), 0.01),
        Case("IPAnema 2, closure", ipanema, ((-4, 4), (-3, 3), (1, 5)), None, 0.03),
        Case("unit square, closure", square, plane, None, 0.005, 1.0),
        Case("triangle, closure", triangle, plane, None, 0.005, 0.5),
        Case("two cables, a weight", hung, ((0, 1), (0, 1)), Requirement(np.array([0.0, 1.0])), 0.005,
             area_of_two_cables(STRENGTH_RATIO)),
        *(Case(f"CoGiRo within {degrees:g}°", cogiro, ((-5, 5), (-4, 4), (0.5, 4.5)), Requirement(gravity=True),
               0.1, angle_deg=degrees) for degrees in (1.0, 5.0)),
        Case("hole of 0.1 µN", holed, around, hole_requirement(1e-7), 1e-5),
    ]  # fmt: skip


def random_positions(proved: CertifiedWorkspace, verdict: int, count: int, rng: np.random.Generator) -> Floats:
    """Return random positions (count, d) in the cells of a verdict, a fifth of them corners, if it has any."""
    chosen = np.flatnonzero(proved.verdict == verdict)
    if not len(chosen):
        return np.zeros((0, proved.rig.dimension))
    volume = proved.cell_volumes[chosen]
    cell = rng.choice(chosen, count, p=volume / volume.sum())
    where = rng.uniform(-0.5, 0.5, (count, proved.rig.dimension))
    where[: count // 5] = np.sign(where[: count // 5]) / 2
    return np.asarray(proved.centres[cell] + where * proved.edges[cell])


def contradictions(case: Case, proved: CertifiedWorkspace, count: int, seed: int = 0) -> tuple[int, int]:
    """Return how many random poses were looked at, half inside and half outside, and how many contradict."""
    rng = np.random.default_rng(seed)
    looked, wrong = 0, 0
    for verdict in (1, -1):
        for start in range(0, count // 2, CHUNK_POSES):
            positions = random_positions(proved, verdict, min(CHUNK_POSES, count // 2 - start), rng)
            looked += len(positions)
            wrong += int((case.holds(positions) != (verdict == 1)).sum())
    return looked, wrong


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=POSES, help="random poses in all")
    options = parser.parse_args()
    every = cases()
    failed = False
    headings = f"{'bounds of the workspace':>26} {'apart':>7} {'known':>8} {'cells':>9} {'s':>6} {'poses':>8}"
    print(f"{'':22} {headings} wrong")
    for number, case in enumerate(every):
        began = time.process_time()
        proved = case.prove()
        processor_s = time.process_time() - began
        low, high = proved.volume
        poses = options.poses // len(every) // (len(SEARCH_STEPS) + 1 if case.angle_deg else 1)
        looked, wrong = contradictions(case, proved, poses, number)
        known = "" if np.isnan(case.volume) else f"{case.volume:.5f}"
        failed |= wrong > 0 or case.volume < low or case.volume > high
        bounds = f"{proved.volume.describe(6)} {proved.unit}"
        print(
            f"{case.name:22} {bounds:>26} {100 * (high - low) / high:6.2f}% {known:>8} {proved.evaluations:9,d} "
            f"{processor_s:6.1f} {looked:8,d} {wrong:5d}"
        )
    found = every[-1].prove()
    outside = found.edges[found.verdict == -1]
    print(f"the hole: {len(outside)} cells proved outside, {1e6 * outside.max(initial=0):.0f} µm wide")
    raise SystemExit(failed or not len(outside))


if __name__ == "__main__":
    main()
