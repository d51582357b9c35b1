"""Workspaces proved over swivelling pulleys, beside those with fixed anchors, held against linear programs.

`python -m benchmarks.certify_pulleys` proves of each rig of the package where it carries what is required, once
with fixed anchors and once with each size of pulleys, in per cent of the mean distance of the anchors from home.
The table has how far the bounds are apart, in per cent of the upper one, and the seconds of all processors
together, which count a busy machine little. Then random poses in proved cells, a fifth of them corners, are held
against the vertices of a linear program whose structure matrices come from trigonometry (`benchmarks.tangents`),
and against HiGHS where those are close. Exit status 1 if one contradicts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import highs
from benchmarks.certify import random_positions
from benchmarks.pulley_error import over_pulleys
from benchmarks.tangents import least_violation, structure_matrix
from tensionlab import datasets
from tensionlab.model import pose
from tensionlab.model.files import load_rig
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace import CertifiedWorkspace, certify

POSES = 1_100_000  # some rigs have no cells of a verdict
CHUNK_POSES = 4_000
SHARES = (0.0, 0.01, 0.05)  # radii, as shares of the mean distance of the anchors from home; 0 is a fixed anchor
FORCE_SHARE = 0.05  # of the largest tension: the forces that are required along each axis
CELLS = {3: 96, 6: 40}  # finest cells along the longest edge of the region, by wrench components
CLOSE = 1e-6  # of the largest tension: closer to a limit, HiGHS decides
EVERY = 50  # HiGHS decides one in so many of the others as well


@dataclass(frozen=True)
class Proof:
    """Rig with what is required of it, what was proved, and in how many seconds of the processor."""

    rig: Rig
    radius: float
    required: Requirement
    proved: CertifiedWorkspace
    processor_s: float

    def holds(self, positions: Floats) -> tuple[NDArray[np.bool_], int]:
        """Return whether linear programs find tensions at the positions (k, d), and how many HiGHS decided.

        There are none where an attachment is inside its pulley.
        """
        rig = self.rig
        pulleys = rig.pulleys_in_world(rig.at_rest)
        radii, axes = (np.zeros(rig.m), np.zeros((rig.m, rig.dimension))) if pulleys is None else pulleys
        arms = None if rig.n == rig.dimension else rig.attachments
        structure = structure_matrix(self.proved.anchors, arms, radii, axes, positions)
        there = np.asarray(np.isfinite(structure).all(axis=(1, 2)))
        structure = structure[there]
        wrenches, lower, upper = self.required.at(rig), rig.limits.lower, rig.limits.upper
        violation = least_violation(structure, wrenches, lower, upper)
        feasible, top = violation <= 0, float(upper.max())
        unsure = (np.abs(violation) < CLOSE * top) | np.isinf(violation)
        drawn = ~unsure & (np.arange(violation.size).reshape(violation.shape) % EVERY == 0)
        checker = highs.feasibility_checker()
        for which in (unsure, drawn):
            rows = np.argwhere(which)
            programs = (highs.model(structure[k], wrenches[w] / top, lower / top, upper / top) for k, w in rows)
            answer = np.array(checker(programs), dtype=bool)
            if which is drawn and (answer != feasible[which]).any():
                raise AssertionError(f"{rig.name}: HiGHS and the vertices disagree")
            feasible[which] = answer
        there[there] = feasible.all(axis=1)
        return there, int(unsure.sum() + drawn.sum())

    def contradictions(self, count: int, seed: int) -> tuple[int, int, int]:
        """Return how many poses were looked at, half of them inside, contradict, and HiGHS decided."""
        rng, looked, wrong, decided = np.random.default_rng(seed), 0, 0, 0
        for verdict in (1, -1):
            for start in range(0, count // 2, CHUNK_POSES):
                positions = random_positions(self.proved, verdict, min(CHUNK_POSES, count // 2 - start), rng)
                if not len(positions):
                    break
                holds, by_highs = self.holds(positions)
                looked, decided = looked + len(holds), decided + by_highs
                wrong += int((holds != (verdict == 1)).sum())
        return looked, wrong, decided


def requirement(rig: Rig) -> Requirement:
    """Return what a rig has to carry: its own requirement, or its weight and forces along all axes."""
    if rig.required:
        return rig.required
    forces = np.zeros(rig.n)
    forces[: rig.dimension] = FORCE_SHARE * rig.limits.upper.max()
    return Requirement(box=forces, gravity=rig.weight is not None)


def proofs(rig: Rig) -> Iterator[Proof]:
    """Prove a rig with fixed anchors and with pulleys of each size."""
    required = requirement(rig)
    anchors = pose.place_anchors(rig.modules, rig.anchors, rig.at_rest)
    region = np.stack(
        [np.minimum(anchors.min(axis=0), rig.home), np.maximum(anchors.max(axis=0), rig.home)], axis=1
    )
    resolution = float(np.ptp(region, axis=1).max()) / CELLS[rig.n]
    size = float(np.linalg.norm(anchors - rig.home, axis=1).mean())
    for share in SHARES:
        led = over_pulleys(rig, share * size) if share else rig
        began = time.process_time()
        proved = certify(led, region, required, resolution, frames=rig.at_rest)
        yield Proof(led, share * size, required, proved, time.process_time() - began)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=POSES, help="random poses in all")
    parser.add_argument("--rigs", nargs="*", default=datasets.names("rigs"), help="rigs; all if left out")
    options = parser.parse_args()
    names = [name.rpartition("/")[2] for name in options.rigs]
    total = np.zeros(3, dtype=np.int64)
    sizes = ["fixed", *(f"{share:.0%}" for share in SHARES[1:])]
    print("| rig | fixed anchors: bounds | " + " | ".join([*sizes, *(f"s, {size}" for size in sizes)]) + " |")
    print("|---|---" + 2 * len(sizes) * "|--:" + "|")
    began = time.perf_counter()
    for name in names:
        found = list(proofs(load_rig(name)))
        bounds = [proof.proved.volume for proof in found]
        apart = [f"{100 * (high - low) / high:.1f} %" if high > 0 else "-" for low, high in bounds]
        seconds = [f"{proof.processor_s:.2f}" for proof in found]
        cells = [f"{bounds[0].describe(4)} {found[0].proved.unit}", *apart, *seconds]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
        for number, proof in enumerate(
            found[1:]
        ):  # the others are held against random poses by benchmarks.certify
            total += proof.contradictions(options.poses // (len(names) * len(found[1:])), number)
    looked, wrong, decided = total
    print(f"\n{looked:,} poses, {decided:,} wrenches of them by HiGHS: {wrong} contradict", end=" ")
    print(f"({time.perf_counter() - began:.0f} s in all)")
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
