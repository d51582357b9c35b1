"""What-if study: the parts of solver and rig in the published error, and what calibration would take away.

``python -m tensionlab.validation.what_if`` goes through the protocol on many simulated rigs like the published
one, of which one thing differs, and writes a row for each (`tensionlab.validation.data_tables`). Tensions are
those of the solver, proved or not: in a run, the runner would have sent the exact solver's in place of the latter.
Rigs are worked out by `predict_forces`, which equals the protocol on stepped modules, but without the rests that
these take where windings get hot: with solvers that pull harder than they must, and in small triangles.

Calibration is held out: a model of the rig is fitted to what half of the vectors showed, all vectors are commanded
again by that model, and the other half is counted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from tensionlab.allocation import allocate
from tensionlab.arrays import Floats
from tensionlab.model.layouts import ring_plus_top
from tensionlab.model.rig import Rig
from tensionlab.records import manifest
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import Solver, Status
from tensionlab.solvers.least_squares import Dykstra
from tensionlab.validation.data_tables import Trial, write_trials
from tensionlab.validation.error_model import PRESETS, ErrorModel, draw_errors
from tensionlab.validation.protocol import AXIS_FORCES, Protocol
from tensionlab.validation.quasi_static import mean_noise, predict_forces
from tensionlab.validation.statistics import MAX_ANGLE_DEG, MODELS, deviations

PAPER_LIKE = PRESETS["paper-like"]
SINGLE_ERRORS = {
    "gain": ErrorModel(gain=PAPER_LIKE.gain, gain_spread=PAPER_LIKE.gain_spread),
    "bias": ErrorModel(bias=PAPER_LIKE.bias),
    "position": ErrorModel(position=PAPER_LIKE.position),
    "play": ErrorModel(play=PAPER_LIKE.play),
    "tilt": ErrorModel(tilt=PAPER_LIKE.tilt),
    "noise": ErrorModel(noise=PAPER_LIKE.noise),
}
"""Each error of the preset by itself."""
SIDE_M, SIDES_M = 1.0, (0.3, 0.4, 0.5, 0.8, 1.0, 1.5, 2.0)
"""Of the triangle."""
ITERATION_LIMITS = (10, 30, 100, 1000)
"""Of Dykstra's algorithm, where it is cut short."""
RIG_COUNT = 200


def study_solvers(rig: Rig) -> dict[str, str | Solver]:
    """Return the solvers that serve the rig, and Dykstra's algorithm cut short."""
    found: dict[str, str | Solver] = {name: name for name, _ in select_solvers(size=(rig.n, rig.m))[0]}
    return found | {f"dykstra, {count} iterations": Dykstra(iteration_limit=count) for count in ITERATION_LIMITS}


class Study:
    """Validations on many rigs, of the same seeds."""

    def __init__(self, protocol: Protocol, seeds: Sequence[int]) -> None:
        self.protocol, self.seeds = protocol, seeds
        self._noise = {seed: mean_noise(1.0, seed, protocol) for seed in seeds}

    def trials(
        self, question: str, choice: str, rig: Rig, errors: ErrorModel, solver: str | Solver = "newton"
    ) -> Iterator[Trial]:
        """Yield a trial for each seed."""
        chosen = allocate(rig.structure_matrix(rig.home), self.protocol.forces, rig.limits, solver=solver)
        desired = self.protocol.forces[AXIS_FORCES:]
        exact = chosen.status[AXIS_FORCES:] == Status.EXACT
        for seed in self.seeds:
            drawn, noise = draw_errors(errors, rig.m, seed), errors.noise * self._noise[seed]
            shown = predict_forces(rig, drawn, chosen.tensions, chosen.wrench[:AXIS_FORCES], noise)
            yield make_trial(question, choice, seed, desired, shown.forces, exact)

    def calibrations(self, rig: Rig, errors: ErrorModel) -> Iterator[Trial]:
        """Yield trials without and after calibration, of the vectors that it did not see."""
        structure, forces = rig.structure_matrix(rig.home), self.protocol.forces
        before = allocate(structure, forces, rig.limits)
        rendered = before.wrench[:AXIS_FORCES]
        for seed in self.seeds:
            drawn, noise = draw_errors(errors, rig.m, seed), errors.noise * self._noise[seed]
            first = predict_forces(rig, drawn, before.tensions, rendered, noise)
            order = np.random.default_rng(seed).permutation(len(forces) - AXIS_FORCES)
            seen, kept = np.split(order, [len(order) // 2])
            desired = forces[AXIS_FORCES:][kept]
            exact = before.status[AXIS_FORCES:][kept] == Status.EXACT
            yield make_trial("calibration", "none", seed, desired, first.forces[kept], exact)
            for name, fit_model in MODELS.items():
                model = fit_model(structure, before.tensions[AXIS_FORCES:][seen], first.forces[seen])
                after = allocate(model.map, forces - model.offset, rig.limits)
                shown = predict_forces(rig, drawn, after.tensions, rendered, noise, rotation=first.rotation)
                exact = after.status[AXIS_FORCES:][kept] == Status.EXACT
                yield make_trial("calibration", name, seed, desired, shown.forces[kept], exact)


def make_trial(
    question: str,
    choice: str,
    seed: int,
    desired: Floats,
    measured: Floats,
    exact: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
) -> Trial:
    """Return the row of a validation, of forces (K, 3) in N and whether the allocation of each is exact."""
    found = deviations(desired, measured)
    return Trial(
        question,
        choice,
        seed,
        vectors=len(desired),
        exact=int(np.sum(exact)),
        angle=float(found.angle.mean()),
        angle_max=float(found.angle.max()),
        magnitude=float(found.magnitude.mean()),
        magnitude_error=float(found.magnitude_error.mean()),
        vector=float(found.vector.mean()),
        within=float(np.mean(found.angle <= MAX_ANGLE_DEG)),
    )


def run_study(count: int = RIG_COUNT, progress: Callable[[str], None] = lambda question: None) -> list[Trial]:
    """Answer all questions, on so many rigs each; ``progress`` receives the next one."""
    every, one = Study(Protocol(), range(count)), Study(Protocol(), [0])
    rig = ring_plus_top(SIDE_M)
    rows: list[Trial] = []
    progress("preset")
    rows += one.trials("preset", "ideal", rig, PRESETS["ideal"])
    rows += every.trials("preset", "paper-like", rig, PAPER_LIKE)
    progress("error")
    for name, errors in SINGLE_ERRORS.items():
        rows += every.trials("error", name, rig, errors)
    progress("solver")
    for name, solver in study_solvers(rig).items():
        rows += every.trials("solver", name, rig, PAPER_LIKE, solver)
        rows += one.trials("solver alone", name, rig, PRESETS["ideal"], solver)
    progress("side")
    for side in SIDES_M:
        rows += every.trials("side", f"{side:g} m", ring_plus_top(side), PAPER_LIKE)
    progress("calibration")
    return rows + list(every.calibrations(rig, PAPER_LIKE))


def median_lines(rows: Sequence[Trial]) -> list[str]:
    """Return the medians over the rigs, a line for each choice."""
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
    parser.add_argument("--rigs", type=int, default=RIG_COUNT, help="simulated rigs for each choice")
    parser.add_argument("--out", type=Path, default=Path("out/what-if-simulated.parquet"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = run_study(options.rigs, lambda question: print(f"{question} ...", file=sys.stderr))
    write_trials(options.out, rows, manifest(["python", "-m", "tensionlab.validation.what_if", *sys.argv[1:]]))
    print("\n".join(median_lines(rows)))


if __name__ == "__main__":
    main()
