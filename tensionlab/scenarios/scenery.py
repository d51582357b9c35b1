"""Scenery of a scenario: surfaces by phase, and the person.

It consists of plain numbers and words, for the logs of runs and the pages of other processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from pydantic import FiniteFloat

from tensionlab.errors import TensionlabError
from tensionlab.haptics.effects.shape import Box, Sphere
from tensionlab.model.bodies import Body, person
from tensionlab.model.module import upward
from tensionlab.model.pose import RestPose
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenario import Phase, Scenario
from tensionlab.support.arrays import Floats
from tensionlab.support.validation import validate

Numbers = tuple[FiniteFloat, ...]
FLAT_PARTS = ("plane", "surface")  # parameters of effects that are flat surfaces
TRUNK = ("head", "torso", "shoulder", "hip")  # parts of a person that its feet are below


@dataclass(frozen=True)
class ScenerySurface:
    """Surface of an effect, or at which brakes hold, in coordinates of the scenario's effects."""

    kind: Literal["plane", "ball", "box", "reach"]  # a reach ends at a distance from the point
    point: Numbers  # of a plane, or the centre, (d,), in m
    normal: Numbers = ()  # of a plane, towards the free side, (d,)
    size: Numbers = ()  # radius, or the edges of a box, in m
    brakes: bool = False  # whether brakes hold there


@dataclass(frozen=True)
class ScenePhase:
    """Phase: its name, times in s since the scenario began, and surfaces."""

    name: str
    begin: FiniteFloat
    end: FiniteFloat
    surfaces: tuple[ScenerySurface, ...]


@dataclass(frozen=True)
class Scenery:
    """Visible parts of a scenario, without its rig."""

    title: str
    phases: tuple[ScenePhase, ...]
    middle: Numbers  # centre of the drawn parts of planes: the mean of the script's waypoints, (d,), in m
    frame: str | None = None  # body frame of the surfaces; the world if None
    feet: Numbers | None = None  # point between the feet of the person, (d,), in m; None: no person is drawn
    labels: Mapping[str, str] | None = None  # names of the held point, and of the bodies
    period: FiniteFloat | None = None  # of a repeated scenario, in s

    def active_phases(self, time: float) -> tuple[ScenePhase, ...]:
        """Return the phases at a time in s since the run began."""
        now = time % self.period if self.period else time
        return tuple(phase for phase in self.phases if phase.begin <= now < phase.end)

    def held_name(self, rig: Rig) -> str:
        """Return the name of the held point, such as the hand."""
        return next((word for key, word in (self.labels or {}).items() if key not in rig.frames), "hand")


def scenery(scenario: Scenario, *, repeat: bool = False) -> Scenery:
    """Return the visible parts of a scenario, which may be repeated."""
    waypoints = [waypoint.position for waypoint in scenario.person.script.waypoints]
    return Scenery(
        title=scenario.title,
        phases=tuple(
            ScenePhase(phase.name, phase.begin, phase.end, tuple(dict.fromkeys(_surfaces(phase, scenario.rig))))
            for phase in scenario.phases
        ),
        middle=tuple(np.mean(waypoints, axis=0).tolist()),
        frame=scenario.frame,
        feet=scenario.feet,
        labels=dict(scenario.labels),
        period=scenario.seconds if repeat else None,
    )


def as_mapping(scenario: Scenario, *, repeat: bool = False) -> dict[str, Any]:
    """Return the scenery of a scenario as plain values, for a log or a `SharedRun`."""
    return asdict(scenery(scenario, repeat=repeat))


def _surfaces(phase: Phase, rig: Rig) -> Iterator[ScenerySurface]:
    """Yield the surfaces of a phase: those of its effects, then where brakes hold."""
    for effect in phase.effects.values():
        for part in (effect, getattr(effect, "wall", None)):
            for name in FLAT_PARTS:
                if (plane := getattr(part, name, None)) is not None:
                    yield ScenerySurface("plane", plane.point, plane.normal)
        solid = getattr(effect, "field", None)
        if isinstance(solid, Sphere):
            yield ScenerySurface("ball", solid.centre, size=(solid.radius,))
        elif isinstance(solid, Box):
            yield ScenerySurface("box", solid.centre, size=solid.size)
    hold = phase.hold
    if hold is not None and hold.plane is not None:
        yield ScenerySurface("plane", hold.plane.point, hold.plane.normal, brakes=True)
    elif hold is not None and hold.reach is not None:
        yield ScenerySurface("reach", (0.0,) * rig.dimension, size=(hold.reach,), brakes=True)


def read_scenery(given: Mapping[str, Any], rig: Rig, where: str, error: type[TensionlabError]) -> Scenery | None:
    """Return the scenery of `as_mapping`; None for an empty mapping.

    Raise the given error, which names where the scenery is from, if it does not fit the rig.
    """
    if not given:
        return None
    scenery = validate(Scenery, given, error, f"{where}: the scenery is damaged")
    points = [scenery.middle, *([scenery.feet] if scenery.feet is not None else [])]
    for surface in (surface for phase in scenery.phases for surface in phase.surfaces):
        points.append(surface.point)
        points += [surface.normal] * (surface.kind == "plane") + [surface.size] * (surface.kind == "box")
        if surface.kind in ("ball", "reach") and len(surface.size) != 1:
            raise error(f"{where}: a {surface.kind} of the scenery has no radius; the log is damaged")
    if any(len(point) != rig.dimension for point in points):
        raise error(f"{where}: the scenery does not have the {rig.dimension} axes of the rig; it is damaged")
    if scenery.frame is not None and scenery.frame not in rig.frames:
        raise error(f'{where}: the scenery is in the frame "{scenery.frame:.40}", which the rig does not have')
    return scenery


def standing_person(
    feet: Floats, up: str, places: Sequence[tuple[str, Floats]]
) -> tuple[tuple[Body, ...], RestPose]:
    """Return the bodies of a person, and the pose of their frame.

    It faces ``places`` (3,) in m that are named as a hand, and stands below those named as a part of its trunk, or
    at ``feet`` (3,). ``up`` is the axis that points up.
    """
    across = 1.0 - np.abs(upward(up, 3))
    trunk = [place for name, place in places if any(part in name for part in TRUNK)]
    at = feet + across * (np.mean(trunk, axis=0) - feet) if trunk else feet
    hands = [place for name, place in places if "hand" in name]
    ahead = across * (np.mean(hands, axis=0) - at) if hands else np.zeros(3)
    return person("standing", up, at, ahead if float(np.linalg.norm(ahead)) > 1e-6 else None)
