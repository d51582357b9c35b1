"""What-if study: the parts of solver and rig in the published error, and what calibration would take away.

``python paper_figures/what_if.py`` goes through the protocol on many simulated rigs like the published
one, of which one thing differs, and writes a row for each (``datasets/what-if/README.md``). Tensions are
those of the solver, proved or not: in a run, the runner would have sent the exact solver's in place of the latter.
Rigs are worked out by `predict_forces`: what the sensor shows once tensions have settled, without steps in time. A
cable's tension follows the motor's pull with a play of the dry friction, to either side; the rest is linear. That
equals the protocol on stepped modules, and is some thousand times faster, but leaves out the rests that these take
where windings get hot: with solvers that pull harder than they must, and in small triangles.

Three models of the force of tensions t, from fewest to most parameters: one gain for all cables, g W t; a gain and
a bias for each, W (g t + b), with the nominal structure matrix W; and any linear map, A t + c, which also takes up
wrong positions and a leaning sensor. Calibration is held out: a model of the rig is fitted to what half of the
vectors showed, all vectors are commanded again by that model, and the other half is counted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from tensionlab.allocation import allocate
from tensionlab.model.layouts import ring_plus_top
from tensionlab.model.rig import Rig
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import Solver, Status
from tensionlab.solvers.least_squares import Dykstra
from tensionlab.support.arrays import Floats
from tensionlab.support.provenance import manifest, write_parquet
from tensionlab.validation.error_model import PRESETS, ErrorModel, RigErrors, draw_errors, true_rig
from tensionlab.validation.protocol import AXIS_FORCES, ZERO_S, Protocol
from tensionlab.validation.sensors import SAMPLE_RATE_HZ, UPRIGHT, DriftNoise
from tensionlab.validation.statistics import ALIGNMENTS, MAX_ANGLE_DEG, deviations, fit_cables

Trial = dict[str, Any]  # validation of one simulated rig: a row of the table
PAPER_LIKE = PRESETS["paper-like"]
SINGLE_ERRORS = {
    "gain": ErrorModel(gain=PAPER_LIKE.gain, gain_spread=PAPER_LIKE.gain_spread),
    "bias": ErrorModel(bias=PAPER_LIKE.bias),
    "position": ErrorModel(position=PAPER_LIKE.position),
    "play": ErrorModel(play=PAPER_LIKE.play),
    "tilt": ErrorModel(tilt=PAPER_LIKE.tilt),
    "noise": ErrorModel(noise=PAPER_LIKE.noise),
}  # each error of the preset by itself
SIDE_M, SIDES_M = 1.0, (0.3, 0.4, 0.5, 0.8, 1.0, 1.5, 2.0)  # of the triangle
ITERATION_LIMITS = (10, 30, 100, 1000)  # of Dykstra's algorithm, where it is cut short
RIG_COUNT = 200
# From the sensor's zero to the first force: a period of the telemetry, where cable lengths fit the home.
ARMING_S = 0.020


@dataclass(frozen=True, eq=False)
class SensorForces:
    """Forces that the sensor shows.

    The rotation (3, 3) leads from the readings, upright, into the devices' axes. ``sensor`` (3 + K, 3) are the
    readings less their zero, in the sensor's axes, in N, the forces on the axes first; ``forces`` (K, 3) the
    others, in the devices' axes.
    """

    rotation: Floats
    sensor: Floats
    forces: Floats


def predict_forces(
    rig: Rig, errors: RigErrors, tensions: Floats, rendered: Floats, noise: Floats, rotation: Floats | None = None
) -> SensorForces:
    """Predict what the sensor of a rig with errors shows of tensions (3 + K, m), commanded one after another.

    Before them, all cables are held at their lower limits. ``rendered`` (3, 3) is the force of the first three by
    the nominal rig, for the alignment, unless its ``rotation`` was found before; ``noise`` (3 + K, 3) comes from
    `mean_noise`.
    """
    real = true_rig(rig, errors)
    pulled = np.maximum(friction_play(errors.gains * tensions, errors.gains * rig.limits.lower, errors.play), 0.0)
    pulled = np.maximum(pulled + errors.biases, 0.0)
    forces = pulled @ real.structure_matrix(real.home, frames=real.at_rest).T @ errors.tilt.T
    upright = forces + noise @ UPRIGHT.T
    if rotation is None:
        rotation = ALIGNMENTS["paper"](rendered, upright[:AXIS_FORCES])
    return SensorForces(rotation, upright @ UPRIGHT, upright[AXIS_FORCES:] @ rotation.T)


def friction_play(pulls: Floats, first: Floats, width: float) -> Floats:
    """Return the tensions of the motors' pulls, (K, m) in N one after another, which stop short by the play.

    ``first`` (m,) are the pulls before, ahead of which cables are slack; ``width`` is the dry friction in N.
    """
    tension = np.maximum(first - width, 0.0)
    found = np.empty_like(pulls)
    for index, pull in enumerate(pulls):
        tension = np.clip(tension, pull - width, pull + width)
        found[index] = tension
    return found


def mean_noise(deviation: float, seed: int, protocol: Protocol) -> Floats:
    """Return the sensor's noise in each average, less that in its zero: (3 + K, 3) in N, in its own axes.

    It comes of the same samples that a `SimulatedSensor` would add.
    """
    count = len(protocol.forces)
    if deviation == 0.0:
        return np.zeros((count, 3))
    zero, hold, settle = (round(SAMPLE_RATE_HZ * each) for each in (ZERO_S, protocol.hold, protocol.settle))
    samples = DriftNoise(deviation, seed).take(2 * zero + round(SAMPLE_RATE_HZ * ARMING_S) + count * hold)
    held = samples[-count * hold :].reshape(count, hold, 3)[:, settle:]
    return np.asarray(held.mean(axis=1) - samples[zero : 2 * zero].mean(axis=0))


@dataclass(frozen=True, eq=False)
class ForceModel:
    """Force of tensions: ``map @ tensions + offset``, with a map (3, m) for the structure matrix, and N."""

    map: Floats
    offset: Floats


def fit_gain(structure: Floats, tensions: Floats, forces: Floats) -> ForceModel:
    """Fit a common gain to forces (K, 3) of tensions (K, m)."""
    nominal = (tensions @ structure.T).ravel()
    gain = float(nominal @ forces.ravel() / (nominal @ nominal))
    return ForceModel(gain * structure, np.zeros(3))


def fit_gains_and_biases(structure: Floats, tensions: Floats, forces: Floats) -> ForceModel:
    """Fit a gain and a bias of each cable."""
    found = fit_cables(structure, tensions, forces).coefficients
    m = structure.shape[1]
    return ForceModel(structure * found[:m], found[m:])


def fit_linear_map(structure: Floats, tensions: Floats, forces: Floats) -> ForceModel:
    """Fit any linear map; the structure matrix plays no part."""
    rows = np.column_stack([tensions, np.ones(len(tensions))])
    found = np.linalg.lstsq(rows, forces, rcond=None)[0]
    return ForceModel(np.ascontiguousarray(found[:-1].T), found[-1])


MODELS = {"one gain": fit_gain, "gain and bias": fit_gains_and_biases, "linear map": fit_linear_map}


def study_solvers(rig: Rig) -> dict[str, str | Solver]:
    """Return the solvers that serve the rig, and Dykstra's algorithm cut short."""
    found: dict[str, str | Solver] = {run.name: run.name for run in select_solvers(size=(rig.n, rig.m))[0]}
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
    question: str, choice: str, seed: int, desired: Floats, measured: Floats, exact: NDArray[np.bool_]
) -> Trial:
    """Return the row of a validation, of forces (K, 3) in N and whether the allocation of each is exact."""
    found = deviations(desired, measured)
    return {
        "question": question,
        "choice": choice,
        "seed": seed,
        "vectors": len(desired),
        "exact": int(np.sum(exact)),
        "angle": float(found.angle.mean()),
        "angle_max": float(found.angle.max()),
        "magnitude": float(found.magnitude.mean()),
        "magnitude_error": float(found.magnitude_error.mean()),
        "vector": float(found.vector.mean()),
        "within": float(np.mean(found.angle <= MAX_ANGLE_DEG)),
    }


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


def medians(rows: Sequence[Trial]) -> DataFrame:
    """Return the medians over the rigs, a row for each question and choice."""
    return DataFrame(rows).drop(columns="seed").groupby(["question", "choice"], sort=False).median()


def main() -> None:
    """Do the study, write its rows and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=RIG_COUNT, help="simulated rigs for each choice")
    parser.add_argument("--out", type=Path, default=Path("out/what-if-simulated.parquet"))
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = run_study(options.rigs, lambda question: print(f"{question} ...", file=sys.stderr))
    call = ["python", "paper_figures/what_if.py", *sys.argv[1:]]
    write_parquet(options.out, rows, {**manifest(call), "simulated": True})
    print(medians(rows).to_string(float_format="%.3f"))


if __name__ == "__main__":
    main()
