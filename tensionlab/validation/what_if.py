"""Which part of the published error is the solver's, which the rig's, and what would calibration take away?

``python -m tensionlab.validation.what_if`` goes through the protocol on many simulated rigs like the
published one, of which one thing differs, and writes a row for each (`tensionlab.validation.trials`). Tensions
are those of the solver, proved or not: in a run, the runner would have sent the exact solver's in place of the
latter.
The rigs are worked out as in `settled`, which equals the protocol on stepped modules, but knows nothing of the
rests that these take where windings get hot: with solvers that pull harder than they must, and in small triangles.

Calibration is held out: a model of the rig is fitted to what half of the vectors showed, all vectors are commanded
again by that model, and the other half is counted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

import tensionlab.validation.trials as table
from tensionlab.allocation import Allocation, allocate
from tensionlab.arrays import Floats
from tensionlab.model.layouts import ring_plus_top
from tensionlab.model.rig import Rig
from tensionlab.records import manifest
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import Solver, Status
from tensionlab.solvers.least_squares import Dykstra
from tensionlab.validation.calibration import MODELS
from tensionlab.validation.error_model import PRESETS, ErrorModel, draw
from tensionlab.validation.protocol import BASIS, Protocol
from tensionlab.validation.quasi_static import settled, wandering
from tensionlab.validation.statistics import WITHIN, deviations
from tensionlab.validation.trials import Trial

LIKE = PRESETS["paper-like"]
ALONE = {
    "gain": ErrorModel(gain=LIKE.gain, gain_spread=LIKE.gain_spread),
    "bias": ErrorModel(bias=LIKE.bias),
    "position": ErrorModel(position=LIKE.position),
    "play": ErrorModel(play=LIKE.play),
    "tilt": ErrorModel(tilt=LIKE.tilt),
    "noise": ErrorModel(noise=LIKE.noise),
}
"""Each error of the preset by itself."""
SIDE, SIDES = 1.0, (0.3, 0.4, 0.5, 0.8, 1.0, 1.5, 2.0)
"""Of the triangle, in m."""
ITERATIONS = (10, 30, 100, 1000)
"""Of Dykstra's algorithm, where it is cut short."""
RIGS = 200


def solvers(rig: Rig) -> dict[str, str | Solver]:
    """Which solvers are tried? Those that serve the rig, and Dykstra's algorithm cut short."""
    found: dict[str, str | Solver] = {name: name for name, _ in select_solvers(size=(rig.n, rig.m))[0]}
    return found | {f"dykstra, {count} iterations": Dykstra(iteration_limit=count) for count in ITERATIONS}


class Study:
    """Many validations on rigs of the same seeds.

    Parameters
    ----------
    protocol : Protocol
    seeds : sequence of int
    """

    def __init__(self, protocol: Protocol, seeds: Sequence[int]) -> None:
        self.protocol, self.seeds = protocol, seeds
        self._noise = {seed: wandering(1.0, seed, protocol) for seed in seeds}

    def trials(
        self, question: str, choice: str, rig: Rig, errors: ErrorModel, solver: str | Solver = "newton"
    ) -> Iterator[Trial]:
        """What is measured on each rig?"""
        chosen = allocate(rig.structure_matrix(rig.home), self.protocol.forces, rig.limits, solver=solver)
        desired = self.protocol.forces[BASIS:]
        exact = int(np.sum(chosen.status[BASIS:] == Status.EXACT))
        for seed in self.seeds:
            drawn = draw(errors, rig.m, seed)
            noise = errors.noise * self._noise[seed]
            felt = settled(rig, drawn, chosen.tensions, chosen.wrench[:BASIS], noise).forces
            yield trial(question, choice, seed, desired, felt, exact)

    def calibrations(self, rig: Rig, errors: ErrorModel) -> Iterator[Trial]:
        """What is measured after calibration, of the vectors that it did not see?"""
        structure, forces = rig.structure_matrix(rig.home), self.protocol.forces
        before = allocate(structure, forces, rig.limits)
        for seed in self.seeds:
            drawn, noise = draw(errors, rig.m, seed), errors.noise * self._noise[seed]
            first = settled(rig, drawn, before.tensions, before.wrench[:BASIS], noise)
            order = np.random.default_rng(seed).permutation(len(forces) - BASIS)
            seen, kept = np.split(order, [len(order) // 2])
            exact = int(np.sum(before.status[BASIS:][kept] == Status.EXACT))
            desired = forces[BASIS:][kept]
            yield trial("calibration", "none", seed, desired, first.forces[kept], exact)
            for name, find in MODELS.items():
                model = find(structure, before.tensions[BASIS:][seen], first.forces[seen])
                after = allocate(model.map, forces - model.offset, rig.limits)
                felt = settled(
                    rig, drawn, after.tensions, before.wrench[:BASIS], noise, rotation=first.rotation
                ).forces
                yield trial("calibration", name, seed, desired, felt[kept], _reached(after, kept))


def _reached(after: Allocation, kept: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> int:
    return int(np.sum(after.status[BASIS:][kept] == Status.EXACT))


def trial(question: str, choice: str, seed: int, desired: Floats, felt: Floats, exact: int) -> Trial:
    """The row of a validation: forces (K, 3) that were to be, and that were felt."""
    found = deviations(desired, felt)
    return Trial(
        question,
        choice,
        seed,
        vectors=len(desired),
        exact=exact,
        angle=float(found.angle.mean()),
        angle_largest=float(found.angle.max()),
        magnitude=float(found.magnitude.mean()),
        magnitude_error=float(found.magnitude_error.mean()),
        vector=float(found.vector.mean()),
        within=float(np.mean(found.angle <= WITHIN)),
    )


def study(count: int = RIGS, told: Callable[[str], None] = lambda question: None) -> list[Trial]:
    """All questions, on so many rigs each; `told` hears which one is next."""
    every, one = Study(Protocol(), range(count)), Study(Protocol(), [0])
    rig = ring_plus_top(SIDE)
    rows: list[Trial] = []
    told("preset")
    rows += one.trials("preset", "ideal", rig, PRESETS["ideal"])
    rows += every.trials("preset", "paper-like", rig, LIKE)
    told("error")
    for name, errors in ALONE.items():
        rows += every.trials("error", name, rig, errors)
    told("solver")
    for name, solver in solvers(rig).items():
        rows += every.trials("solver", name, rig, LIKE, solver)
        rows += one.trials("solver alone", name, rig, PRESETS["ideal"], solver)
    told("side")
    for side in SIDES:
        rows += every.trials("side", f"{side:g} m", ring_plus_top(side), LIKE)
    told("calibration")
    return rows + list(every.calibrations(rig, LIKE))


def lines(rows: Sequence[Trial]) -> list[str]:
    """The medians over the rigs, a line for each choice."""
    found = [f"{'median of the rigs':36} angle error   10-90 %      |F|  ||F|-|F0||  |F-F0|  all in 45°     exact"]
    for question, choice in dict.fromkeys((row.question, row.choice) for row in rows):
        chosen = [row for row in rows if (row.question, row.choice) == (question, choice)]
        angles = [row.angle for row in chosen]
        low, high = np.quantile(angles, [0.1, 0.9])
        sizes = [
            float(np.median([getattr(row, name) for row in chosen]))
            for name in ("magnitude", "magnitude_error", "vector")
        ]
        within = np.mean([row.within == 1.0 for row in chosen])
        exact = f"{np.median([row.exact for row in chosen]):.0f} of {chosen[0].vectors}"
        found.append(
            f"{question:13} {choice:24} {np.median(angles):8.2f}°  {low:4.1f}-{high:4.1f}°  "
            f"{sizes[0]:6.3f}  {sizes[1]:10.3f}  {sizes[2]:6.3f}  {within:9.0%}  {exact:>10}"
        )
    return found


def main() -> None:
    """Do the study, write its rows and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=RIGS, help="simulated rigs for each choice")
    parser.add_argument("--out", type=Path, default=Path("out/what-if-simulated.parquet"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = study(options.rigs, lambda question: print(f"{question} ...", file=sys.stderr))
    call = ["python", "-m", "tensionlab.validation.what_if", *sys.argv[1:]]
    table.write(options.out, rows, manifest(call))
    print("\n".join(lines(rows)))


if __name__ == "__main__":
    main()
