"""What do measured forces tell about a rig, and which rig should the host reckon with instead?

From half of the vectors; the other half shows what it is worth. Three models of the force that tensions t make,
from the least to the most: one gain for all cables, g W t; a gain and a bias for each, W (g t + b), with the
nominal structure matrix W; and any linear map, A t + c, which also takes up wrong positions and a leaning sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.hardware.calibration.gain import Estimate, LinearFit, around, fit


@dataclass(frozen=True, eq=False)
class Model:
    """Which force do tensions make: ``map @ tensions + offset``.

    Attributes
    ----------
    map : (3, m) array
        In the place of the structure matrix.
    offset : (3,) array
        In N.
    """

    map: Floats
    offset: Floats


@dataclass(frozen=True, eq=False)
class Cables:
    """Gain and bias of each cable.

    Attributes
    ----------
    gains : tuple of Estimate
        True tension per commanded one.
    biases : tuple of Estimate
        In N. Of four cables on a point only three combinations of biases can be felt: these are the smallest ones
        that make the offset, without the part that cancels out at the point.
    """

    gains: tuple[Estimate, ...]
    biases: tuple[Estimate, ...]


def one_gain(structure: Floats, tensions: Floats, forces: Floats) -> Model:
    """Which common gain explains forces (K, 3) by tensions (K, m) best?"""
    nominal = (tensions @ structure.T).ravel()
    gain = float(nominal @ forces.ravel() / (nominal @ nominal))
    return Model(gain * structure, np.zeros(3))


def gains_and_biases(structure: Floats, tensions: Floats, forces: Floats) -> Model:
    """Which gain and bias of each cable explain forces best?"""
    found = _fit_cables(structure, tensions, forces).coefficients
    m = structure.shape[1]
    return Model(structure * found[:m], found[m:])


def any_map(structure: Floats, tensions: Floats, forces: Floats) -> Model:
    """Which linear map explains forces best? The structure matrix plays no part."""
    rows = np.column_stack([tensions, np.ones(len(tensions))])
    found = np.linalg.lstsq(rows, forces, rcond=None)[0]
    return Model(np.ascontiguousarray(found[:-1].T), found[-1])


MODELS = {"one gain": one_gain, "gain and bias": gains_and_biases, "linear map": any_map}


def cables(structure: Floats, tensions: Floats, forces: Floats) -> Cables:
    """How large are gain and bias of each cable, with 95 % confidence, if positions are right?

    Parameters
    ----------
    structure : (3, m) array
    tensions : (K, m) array
        As they were commanded, in N.
    forces : (K, 3) array
        As they were measured, in the axes of the structure matrix, in N.
    """
    found = _fit_cables(structure, tensions, forces)
    m = structure.shape[1]
    inverse = np.linalg.pinv(structure)
    biases = inverse @ found.coefficients[m:]
    spread = np.sqrt(np.diag(inverse @ found.covariance[m:, m:] @ inverse.T))
    gains = [
        around(float(found.coefficients[i]), float(np.sqrt(found.covariance[i, i])), found.freedom)
        for i in range(m)
    ]
    return Cables(
        tuple(gains), tuple(around(float(b), float(s), found.freedom) for b, s in zip(biases, spread, strict=True))
    )


def _fit_cables(structure: Floats, tensions: Floats, forces: Floats) -> LinearFit:
    """Gains of the cables, and the offset that their biases make."""
    count, m = tensions.shape
    rows = np.concatenate(
        [tensions[:, None, :] * structure, np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2
    ).reshape(-1, m + 3)
    return fit(rows, forces.ravel())
