"""What came of a validation: forces turned into the devices' axes, and their statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.experiments.validation.alignment import ALIGNMENTS, UPRIGHT, angle
from tensionlab.experiments.validation.protocol import BASIS, Measurement
from tensionlab.experiments.validation.statistics import Score, deviations, score
from tensionlab.model.kinematics import Floats

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
        return angle(self.aligned["kabsch"].rotation @ self.aligned["yaw"].rotation.T)

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


def columns(result: Result, modules: Sequence[str]) -> dict[str, Any]:
    """The table of all forces but the axes: columns by name.

    Forces in N, in the devices' axes: ``desired_x``, ``rendered_x``, ``measured_x`` (aligned as published) and
    ``kabsch_x``, and so on for y and z; ``sensor_x`` in the sensor's own axes; ``tension_NAME`` of each module, in
    N; ``angle`` in degrees, ``magnitude``, ``magnitude_error`` and ``vector_error`` in N, aligned as published.
    """
    kept = result.measurements[BASIS:]
    vectors = {
        "desired": result.desired,
        "rendered": np.array([each.rendered for each in kept]),
        "measured": result.aligned["yaw"].forces,
        "kabsch": result.aligned["kabsch"].forces,
        "sensor": np.array([each.measured for each in kept]),
    }
    table: dict[str, Any] = {"number": [each.number for each in kept]}
    for name, values in vectors.items():
        table |= {f"{name}_{axis}": values[:, index] for index, axis in enumerate("xyz")}
    tensions = np.array([each.tensions for each in kept])
    table |= {f"tension_{name}": tensions[:, index] for index, name in enumerate(modules)}
    found = deviations(result.desired, vectors["measured"])
    table |= {"angle": found.angle, "magnitude": found.magnitude}
    table |= {"magnitude_error": found.magnitude_error, "vector_error": found.vector}
    table |= {"status": [each.status for each in kept], "replaced": [each.replaced for each in kept]}
    table |= {"samples": [each.samples for each in kept], "spread": [each.spread for each in kept]}
    return table
