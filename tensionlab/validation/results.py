"""What came of a validation: forces turned into the devices' axes, and their statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.validation.alignment import ALIGNMENTS, UPRIGHT, angle
from tensionlab.validation.drift_noise import RATE
from tensionlab.validation.protocol import BASIS, Measurement
from tensionlab.validation.recordings import Recording
from tensionlab.validation.statistics import Score, score

TILTED = 1.0
"""Degrees by which the two ways to align may differ before the report speaks of tilt."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """The measured forces after one way to find out how the sensor is turned.

    Attributes
    ----------
    rotation : (3, 3) array
    turn : float
        By how many degrees that turns.
    forces : (K, 3) array
        In the devices' axes, in N.
    score : Score
    """

    rotation: Floats
    turn: float
    forces: Floats
    score: Score


@dataclass(frozen=True, eq=False)
class Result:
    """What came of a validation?

    Attributes
    ----------
    setup : mapping
        As `sitting.Plan.setup` says.
    measurements : tuple of Measurement
        All of them, the axes first.
    desired : (K, 3) array
        Without the axes, in N.
    aligned : dict of str to Aligned
        By the key of `ALIGNMENTS`.
    """

    setup: Mapping[str, Any]
    measurements: tuple[Measurement, ...]
    desired: Floats
    aligned: dict[str, Aligned]

    @property
    def exact(self) -> int:
        """How many forces were within the reach of the nominal rig?"""
        return sum(each.status == "EXACT" for each in self.measurements[BASIS:])

    @property
    def replaced(self) -> int:
        """How many answers of the solver were not proved, so that the exact solver's were sent?"""
        return sum(each.replaced for each in self.measurements[BASIS:])

    @property
    def tilt(self) -> float:
        """By how many degrees do the two ways to align differ? That tilt stays in the published way."""
        return angle(self.aligned["kabsch"].rotation @ self.aligned["paper"].rotation.T)

    @property
    def rested(self) -> float:
        """How long did modules have to cool between forces, in s?"""
        return sum(each.rested for each in self.measurements)

    @property
    def hindered(self) -> dict[str, int]:
        """At how many forces did something keep a module from pulling as it was told, by its name?"""
        names = [name for each in self.measurements for name in each.hindered]
        return {name: names.count(name) for name in dict.fromkeys(names)}


def result_of(setup: Mapping[str, Any], measurements: Sequence[Measurement]) -> Result:
    """What came of a validation that is complete?

    The alignment compares with what the tensions on the three axes add up to by the nominal rig, which is what was
    asked for wherever that is within reach.
    """
    measured = np.array([each.measured for each in measurements]) @ UPRIGHT.T
    rendered = np.array([each.rendered for each in measurements])
    desired = np.array([each.desired for each in measurements])[BASIS:]
    aligned = {}
    for name, find in ALIGNMENTS.items():
        rotation = find(rendered[:BASIS], measured[:BASIS])
        forces = measured[BASIS:] @ rotation.T
        aligned[name] = Aligned(rotation, angle(rotation), forces, score(desired, forces))
    return Result(setup, tuple(measurements), desired, aligned)


def recording_of(result: Result, rig: Rig, sensor: str, manifest: Mapping[str, Any]) -> Recording:
    """The forces without the axes, as a recording that others can read, aligned as published.

    Parameters
    ----------
    result : Result
    rig : Rig
    sensor : str
        What measured.
    manifest : mapping
        Where it comes from: `tensionlab.records.manifest`.
    """
    kept, setup = result.measurements[BASIS:], result.setup
    about = {
        "simulated": setup["simulated"],
        "rig": rig.name,
        "modules": [module.name for module in rig.modules],
        "solver": setup["solver"],
        "sensor": sensor,
        "rotations": {name: (each.rotation @ UPRIGHT).tolist() for name, each in result.aligned.items()},
        "alignment": "paper",
        "rate": float(RATE),
        "hold": setup["hold"],
        "settle": setup["settle"],
        "preset": setup["preset"],
    }
    return Recording(
        desired=result.desired,
        rendered=np.array([each.rendered for each in kept]),
        measured=result.aligned["paper"].forces,
        tensions=np.array([each.tensions for each in kept]),
        spread=np.array([each.spread for each in kept]),
        status=np.array([Status[each.status] for each in kept], dtype=np.int64),
        replaced=np.array([each.replaced for each in kept]),
        samples=np.array([each.samples for each in kept]),
        hindered=np.array([" ".join(each.hindered) for each in kept]),
        manifest={**manifest, "recording": about},
    )
