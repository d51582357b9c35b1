"""Scenery of a scenario: surfaces by phase, and the person as a stick figure.

It consists of plain numbers and words, for the logs of runs and the pages of other processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import permutations
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import FiniteFloat

from tensionlab.errors import TensionlabError
from tensionlab.haptics.effects.shape import Box, Sphere
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenario import Phase, Scenario
from tensionlab.support.arrays import Floats
from tensionlab.support.validation import validate

Numbers = tuple[FiniteFloat, ...]
FLAT_PARTS = ("plane", "surface")  # parameters of effects that are flat surfaces
# Default heights of the joints of a standing person.
JOINT_HEIGHTS_M = {"hip": 0.92, "shoulder": 1.42, "head": 1.66}
LIMB_M = 0.30  # length of an upper arm, and of a forearm with half a hand
# From the middle to a shoulder, from the middle to a foot, and of the head's radius.
SHOULDER_M, STANCE_M, HEAD_M = 0.18, 0.12, 0.10


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
    found = validate(Scenery, given, error, f"{where}: the scenery is damaged")
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


class StickFigure(NamedTuple):
    """Limbs and trunk as lines (k, 3) through joints, and the centre of the head (3,), in m."""

    lines: list[Floats]
    head: Floats


def stick_figure(feet: Floats, up: Floats, places: Sequence[tuple[str, Floats]]) -> StickFigure:
    """Return a person who stands at a point between its feet (3,) in m, with known parts at their places.

    ``up`` (3,) is a unit vector; ``places`` are names and positions (3,), where "hand", "head", "torso" (between
    the shoulders), "shoulder", "hip" or "foot" in a name tells the part.
    """
    parts = (*JOINT_HEIGHTS_M, "torso", "hand", "foot")
    known = {part: [place for name, place in places if part in name] for part in parts}

    def mean_of(part: str, otherwise: Floats) -> Floats:
        return np.mean(known[part], axis=0) if known[part] else otherwise

    hips, shoulders, head = (mean_of(part, feet + height * up) for part, height in JOINT_HEIGHTS_M.items())
    towards = mean_of("hand", shoulders) - feet
    ahead = towards - (towards @ up) * up  # along the floor
    length = np.linalg.norm(ahead)
    ahead = ahead / length if length > 1e-6 else np.roll(np.abs(up), 1)
    left = np.cross(up, ahead)
    if len(known["shoulder"]) == 1:  # the right one or the left one
        shoulders = shoulders - np.sign(left @ (known["shoulder"][0] - feet)) * SHOULDER_M * left
    shoulders = mean_of("torso", shoulders)
    neck = (JOINT_HEIGHTS_M["head"] - JOINT_HEIGHTS_M["shoulder"]) * up
    if known["head"] and not (known["shoulder"] or known["torso"]):
        shoulders = head - neck
    if not known["head"]:
        head = shoulders + neck
    soles = known["foot"] or [feet + side * STANCE_M * (left + ahead) for side in (1.0, -1.0)]
    ends = [shoulders + side * SHOULDER_M * left for side in (-1.0, 1.0)]
    hands = known["hand"] + [end - 2 * LIMB_M * up for end in ends][len(known["hand"]) :]
    pairs = [list(pair) for pair in permutations(hands[:2])]
    hands = min(pairs, key=lambda pair: float(np.linalg.norm(np.array(ends) - np.array(pair), axis=1).sum()))
    lines = [*([hips, foot] for foot in soles), [hips, shoulders, head], ends]
    lines += [[end, _elbow(end, hand, -up), hand] for end, hand in zip(ends, hands, strict=True)]
    return StickFigure([np.array(line) for line in lines], head)


def _elbow(shoulder: Floats, hand: Floats, down: Floats) -> Floats:
    """Return the elbow, which hangs down."""
    arm = hand - shoulder
    size, middle = float(np.linalg.norm(arm)), shoulder + arm / 2
    if size >= 2 * LIMB_M or size == 0.0:
        return middle
    hanging = down - (down @ arm) / size**2 * arm
    if (length := float(np.linalg.norm(hanging))) > 1e-6:
        middle = middle + hanging / length * np.sqrt(LIMB_M**2 - size**2 / 4)
    return middle
