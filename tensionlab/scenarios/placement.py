"""Placement of a scenario on a rig: moved to where the hand is, turned to where the person faces, and scaled."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.allocation import Status, allocate
from tensionlab.errors import RigError, ScenarioError
from tensionlab.haptics.effects import Box, Sphere
from tensionlab.haptics.effects.parameters import vectors
from tensionlab.model.rig import Rig
from tensionlab.scenarios.person import Script
from tensionlab.scenarios.scenario import BrakeTarget, Phase, Scenario
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_vector

SCALES = np.linspace(1.0, 0.5, 11)  # sizes that are tried, the largest first
PATH_STEP_S = 0.02  # time between the checked positions of the hand


@dataclass(frozen=True, eq=False)
class Similarity:
    """Map of points, ``at + scale rotation (p - start)``."""

    rotation: Floats  # (d, d)
    start: Floats  # (d,), in m
    at: Floats  # (d,), in m
    scale: float = 1.0

    def point(self, point: ArrayLike) -> tuple[float, ...]:
        """Return where a point comes to."""
        placed = self.at + self.scale * self.rotation @ (np.array(point) - self.start)
        return tuple((placed.round(12) + 0.0).tolist())

    def direction(self, direction: ArrayLike) -> tuple[float, ...]:
        """Return a direction, turned."""
        return tuple((np.round(self.rotation @ np.array(direction), 12) + 0.0).tolist())

    def script(self, script: Script) -> Script:
        """Return a motion, its path scaled and its sway not."""
        waypoints = tuple(replace(each, position=self.point(each.position)) for each in script.waypoints)
        sway = script.sway
        if sway is not None:
            sway = replace(sway, amplitude=tuple(np.sqrt(self.rotation**2 @ np.square(sway.amplitude)).tolist()))
        return replace(script, waypoints=waypoints, sway=sway)

    def surfaces(self, part: Any, name: str) -> Any:
        """Return an effect or a brake target with its points, directions and solids placed."""
        placed: dict[str, Any] = {}
        known = vectors(type(part))
        for each in fields(part):
            value = getattr(part, each.name)
            if isinstance(part, Box) and each.name == "size":
                placed["size"] = self._edges(part, name)
            elif isinstance(part, Sphere) and each.name == "radius":
                placed["radius"] = self.scale * value
            elif each.name in known:
                placed[each.name] = self.direction(value) if known[each.name].oriented else self.point(value)
            elif is_dataclass(value):
                placed[each.name] = self.surfaces(value, name)
        return replace(part, **placed) if placed else part

    def _edges(self, box: Box, name: str) -> tuple[float, ...]:
        axes = np.abs(self.rotation)
        if not np.allclose(axes, axes.round(), atol=1e-9):
            raise ScenarioError(f'effect "{name}" has a box, which lies along the axes; face along one of them')
        return tuple((self.scale * axes.round() @ np.array(box.size)).tolist())


def place(scenario: Scenario, rig: Rig, at: ArrayLike | None = None, facing: ArrayLike | None = None) -> Scenario:
    """Return a scenario where the hand is on a rig, in the rig's axes.

    The hand, the bodies and the person move and turn as a whole. Paths and surfaces are also scaled, by the
    largest of `SCALES` with which the cables hold the hand on its whole path; effects in a body's frame are not,
    nor are materials, such as a stiffness or the period of ripples.

    Parameters
    ----------
    scenario : Scenario
        Scenario that was loaded on this rig, or on one with the same body frames.
    rig : Rig
        Rig of a point that says which axis is up.
    at : (d,) array_like, optional
        Where the hand starts, in m; the rig's home if left out.
    facing : (d,) array_like, optional
        Where the person faces, which is x in a scenario with z up; along the floor. Left out: the axis after the
        one that is up.

    Raises
    ------
    ScenarioError
        If the hand's path does not fit into the rig's reach, or the scenario cannot be placed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.scenarios import load_scenario, place
    >>> rig = tl.load_rig("seven-modules")
    >>> place(load_scenario("materials", "seven-modules"), rig, at=[0.2, 1.3, 0.1], facing=[1, 0, 0]).placement
    'placed at (0.2, 1.3, 0.1) m, facing (1, 0, 0)'
    """
    if rig.up is None or scenario.up is None:
        raise ScenarioError(f'scenario "{scenario.name}" or rig "{rig.name}" has no key "up"; give it')
    here = rig.home if at is None else np.asarray(at, dtype=np.float64)
    front = np.roll(np.abs(rig.upward), 1) if facing is None else np.asarray(facing, dtype=np.float64)
    level = front - (front @ rig.upward) * rig.upward
    size = float(np.linalg.norm(level))
    if size < 1e-6:
        raise ScenarioError(f"facing {format_vector(front)} points up or down; give a direction along the floor")
    rotation = _axes(rig.upward, level / size) @ _axes(scenario.rig.upward).T
    text = f"placed at {format_vector(here)} m, facing {format_vector((level / size).round(2) + 0.0)}"
    start = np.array(scenario.person.script.waypoints[0].position)
    for scale in SCALES[:1] if scenario.frame is not None else SCALES:
        sized = text if scale == 1.0 else f"{text}, at {100.0 * scale:.0f} % of its size"
        placed = _placed(scenario, rig, Similarity(rotation, start, here, scale), sized)
        path, held = _held(placed)
        if held.all() or _holds_nothing(rig):
            return placed
        missed = path[int(np.argmin(held))]
    raise ScenarioError(
        f'scenario "{scenario.name}" does not fit: {sized}, the cables of rig "{rig.name}" do not hold '
        f"the hand at {format_vector(missed.round(2) + 0.0)} m; start elsewhere (the rig's home is "
        f"{format_vector(rig.home)} m), or give another rig"
    )


def _axes(up: Floats, front: Floats | None = None) -> Floats:
    """Return the orthonormal axes ahead, aside and up as columns; ahead is the axis after the one that is up."""
    ahead = np.roll(np.abs(up), 1) if front is None else front
    return np.stack([ahead, up] if up.size == 2 else [ahead, np.cross(up, ahead), up], axis=1)


def _placed(scenario: Scenario, rig: Rig, similarity: Similarity, text: str) -> Scenario:
    """Return the scenario mapped into the rig's axes."""
    rigid = replace(similarity, scale=1.0)
    person = scenario.person
    bodies = {}
    for name, script in person.bodies.items():
        start: Floats = np.array(script.waypoints[0].position)
        bodies[name] = replace(similarity, start=start, at=np.array(rigid.point(start))).script(script)
    origin = np.zeros(rig.dimension)
    surfaces = similarity if scenario.frame is None else replace(rigid, start=origin, at=origin)
    return replace(
        scenario,
        rig=rig,
        up=rig.up,
        person=replace(person, script=similarity.script(person.script), bodies=bodies),
        phases=tuple(_phase(phase, surfaces, scenario) for phase in scenario.phases),
        feet=None if scenario.feet is None else rigid.point(scenario.feet),
        placement=text,
    )


def _phase(phase: Phase, surfaces: Similarity, scenario: Scenario) -> Phase:
    """Return a phase with its surfaces placed."""
    if isinstance(phase.hold, BrakeTarget) and phase.hold.reach is not None and scenario.frame is None:
        raise ScenarioError(f'phase "{phase.name}" holds at a reach from the origin; give a plane to place it')
    effects = {name: surfaces.surfaces(effect, name) for name, effect in phase.effects.items()}
    hold = None if phase.hold is None else surfaces.surfaces(phase.hold, f"{phase.name}: hold")
    return replace(phase, effects=effects, hold=hold)


def _held(scenario: Scenario) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the path of the hand (K, d), and where the cables hold it."""
    rig, person = scenario.rig, scenario.person
    times = np.arange(0.0, scenario.seconds, PATH_STEP_S)
    path = np.array([person.script.position(time) for time in times])
    frames = {
        name: (np.array([person.bodies[name].position(time) for time in times]), None) for name in rig.frames
    }
    try:
        structure = rig.structure_matrix(path, frames=frames)
    except RigError:  # the hand comes to an anchor
        return path, np.zeros(len(path), dtype=np.bool_)
    return path, allocate(structure, rig.required.middle(rig), rig.limits).status == Status.EXACT


def _holds_nothing(rig: Rig) -> bool:
    """Return whether cables cannot hold the hand at all, not even at the rig's home."""
    home = rig.structure_matrix(rig.home, frames=rig.at_rest)
    return rig.m <= rig.n or bool(allocate(home, rig.required.middle(rig), rig.limits).status != Status.EXACT)
