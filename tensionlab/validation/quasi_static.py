"""Quasi-static model of the protocol: what the sensor shows once tensions have settled, without steps in time.

A cable's tension follows the motor's pull with a play of the dry friction, to either side; the rest is linear.
That is what firmware and plant come to when the spool does not ring, as a test shows; it is some thousand times
faster, so that hundreds of rigs can be tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.rig import Rig
from tensionlab.validation.error_model import RigErrors, true_rig
from tensionlab.validation.protocol import AXIS_FORCES, ZERO_S, Protocol
from tensionlab.validation.sensors import SAMPLE_RATE_HZ, UPRIGHT
from tensionlab.validation.simulated_sensor import DriftNoise
from tensionlab.validation.statistics import ALIGNMENTS

ARMING_S = 0.020
"""From the sensor's zero to the first force: a period of the telemetry."""


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
