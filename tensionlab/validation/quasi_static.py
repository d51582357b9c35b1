"""What would the protocol measure? Worked out for tensions that have settled, without stepping through time.

A cable's tension follows the motor's pull with a play of the dry friction, to either side; the rest is linear.
That is what firmware and plant come to when the spool does not ring, as a test shows; it is some thousand times
faster, so that hundreds of rigs can be tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.rig import Rig
from tensionlab.validation.alignment import ALIGNMENTS, UPRIGHT
from tensionlab.validation.drift_noise import RATE, Wander
from tensionlab.validation.error_model import Errors, true_rig
from tensionlab.validation.protocol import BASIS, ZERO, Protocol

ARMING = 0.020
"""From the sensor's zero to the first force, in s: a period of the telemetry."""


@dataclass(frozen=True, eq=False)
class Settled:
    """What a sensor would show.

    Attributes
    ----------
    rotation : (3, 3) array
        What turns the readings, upright, into the devices' axes.
    sensor : (3 + K, 3) array
        Its readings less its zero, in its own axes, in N; the forces on the axes first.
    forces : (K, 3) array
        The others, in the devices' axes.
    """

    rotation: Floats
    sensor: Floats
    forces: Floats


def settled(
    rig: Rig, errors: Errors, tensions: Floats, rendered: Floats, noise: Floats, rotation: Floats | None = None
) -> Settled:
    """What does the sensor of a rig with errors show of tensions that are commanded one after another?

    Parameters
    ----------
    rig : Rig
        As the host believes it to be.
    errors : Errors
    tensions : (3 + K, m) array
        In N; before them, all cables are held at their lower limits.
    rendered : (3, 3) array
        What the first three add up to by the nominal rig, for the alignment.
    noise : (3 + K, 3) array
        To be added, from `wandering`.
    rotation : (3, 3) array, optional
        As it was found before; found from the first three if left out.
    """
    real = true_rig(rig, errors)
    pulled = np.maximum(play(errors.gains * tensions, errors.gains * rig.limits.lower, errors.play), 0.0)
    pulled = np.maximum(pulled + errors.biases, 0.0)
    forces = pulled @ real.structure_matrix(real.home, frames=real.at_rest).T @ errors.tilt.T
    upright = forces + noise @ UPRIGHT.T
    if rotation is None:
        rotation = ALIGNMENTS["paper"](rendered, upright[:BASIS])
    return Settled(rotation, upright @ UPRIGHT, upright[BASIS:] @ rotation.T)


def play(pulls: Floats, first: Floats, width: float) -> Floats:
    """Which tensions come of the motors' pulls (K, m), one after another, if each stops short by so much?

    Parameters
    ----------
    pulls : (K, m) array
        In N.
    first : (m,) array
        Pulls before the first ones; cables are slack before these.
    width : float
        Dry friction, in N.
    """
    tension = np.maximum(first - width, 0.0)
    found = np.empty_like(pulls)
    for index, pull in enumerate(pulls):
        tension = np.clip(tension, pull - width, pull + width)
        found[index] = tension
    return found


def wandering(deviation: float, seed: int, protocol: Protocol) -> Floats:
    """What does the sensor's noise add to each average, less its zero? (3 + K, 3) array in N, in its own axes.

    The same samples that a `SimulatedSensor` would add.
    """
    count = len(protocol.forces)
    if deviation == 0.0:
        return np.zeros((count, 3))
    zero, hold, settle = (round(RATE * each) for each in (ZERO, protocol.hold, protocol.settle))
    samples = Wander(deviation, seed).take(2 * zero + round(RATE * ARMING) + count * hold)
    held = samples[-count * hold :].reshape(count, hold, 3)[:, settle:]
    return np.asarray(held.mean(axis=1) - samples[zero : 2 * zero].mean(axis=0))
