"""Scenery of a scenario: surfaces by phase, and where the person stands.

Plain numbers and words, so that logs of runs and pages of other processes have it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from pydantic import FiniteFloat, TypeAdapter, ValidationError

from tensionlab.errors import TensionlabError
from tensionlab.haptics.effects.shape import Box, Sphere
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenario import Phase, Scenario
from tensionlab.support.files.reading import brief

Numbers = tuple[FiniteFloat, ...]
FLAT_PARTS = ("plane", "surface")  # parameters of effects that are flat surfaces


@dataclass(frozen=True)
class ScenerySurface:
    """Surface of an effect, or at which brakes hold, in coordinates of the scenario's effects.

    Attributes
    ----------
    kind : "plane", "ball", "box" or "reach"
        A reach ends at a distance from the point.
    point : tuple of d floats
        Of a plane, or the centre, in m.
    normal : tuple of d floats
        Of a plane, towards the free side; empty for others.
    size : tuple of floats
        Radius, or the edges of a box, in m; empty for a plane.
    brakes : bool
        Whether brakes hold there.
    """

    kind: Literal["plane", "ball", "box", "reach"]
    point: Numbers
    normal: Numbers = ()
    size: Numbers = ()
    brakes: bool = False


@dataclass(frozen=True)
class ScenePhase:
    """Phase: its name, times in s since the scenario began, and surfaces."""

    name: str
    begin: FiniteFloat
    end: FiniteFloat
    surfaces: tuple[ScenerySurface, ...]


@dataclass(frozen=True)
class Scenery:
    """Visible parts of a scenario, without its rig.

    Attributes
    ----------
    title : str
    phases : tuple of ScenePhase
    middle : tuple of d floats
        About which parts of planes are drawn: the mean of the script's waypoints, in m.
    frame : str or None
        Body frame in which surfaces are; the world if None.
    feet : tuple of d floats or None
        Point between the feet of the person, in m; None: no person is drawn.
    labels : mapping of str to str
        Names of the held point, and of the bodies.
    period : float or None
        After which it begins anew, in s; None: it does not.

    Examples
    --------
    >>> from tensionlab.scenarios import load_scenario
    >>> from tensionlab.scenarios.scenery import scenery
    >>> [surface.kind for phase in scenery(load_scenario("bow")).phases for surface in phase.surfaces]
    ['reach']
    """

    title: str
    phases: tuple[ScenePhase, ...]
    middle: Numbers
    frame: str | None = None
    feet: Numbers | None = None
    labels: Mapping[str, str] | None = None
    period: FiniteFloat | None = None

    def active_phases(self, time: float) -> tuple[ScenePhase, ...]:
        """Return the phases at a time in s since the run began."""
        now = time % self.period if self.period else time
        return tuple(phase for phase in self.phases if phase.begin <= now < phase.end)

    def held_name(self, rig: Rig) -> str:
        """Return the name of the held point, such as the hand."""
        return next((word for key, word in (self.labels or {}).items() if key not in rig.frames), "")


def scenery(scenario: Scenario, *, repeat: bool = False) -> Scenery:
    """Return what of a scenario can be seen; ``repeat`` if it begins anew when it is over."""
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
    """Return the scenery that `as_mapping` gave; None for an empty mapping.

    Raises
    ------
    TensionlabError
        The one that is given, naming where it is from, if it is none of this rig.
    """
    if not given:
        return None
    try:
        found = _READER.validate_python(given)
    except ValidationError as problem:
        first = problem.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise error(f"{where}: the scenery's {place} is {brief(first['input'])}; the log is damaged") from None
    points = [found.middle, *([found.feet] if found.feet is not None else [])]
    for surface in (each for phase in found.phases for each in phase.surfaces):
        points.append(surface.point)
        points += [surface.normal] * (surface.kind == "plane") + [surface.size] * (surface.kind == "box")
        if surface.kind in ("ball", "reach") and len(surface.size) != 1:
            raise error(f"{where}: a {surface.kind} of the scenery has no radius; the log is damaged")
    if any(len(point) != rig.dimension for point in points):
        raise error(f"{where}: the scenery does not have the {rig.dimension} axes of the rig; it is damaged")
    if found.frame is not None and found.frame not in rig.frames:
        raise error(f'{where}: the scenery is in the frame "{found.frame:.40}", which the rig does not have')
    return found


_READER = TypeAdapter(Scenery)
