"""Scenarios: a rig, a person, effects and brake targets by phase; read from TOML by name or path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, InstanceOf

from tensionlab.allocation import Policy, Status, allocate
from tensionlab.errors import EffectError, RigError, ScenarioError
from tensionlab.haptics.effects import Plane
from tensionlab.haptics.effects.effect import norm, normalized
from tensionlab.haptics.effects.parameters import Length, PositiveForce, checked_dataclass, require_dimension
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.haptics.rendering.brakes import TIMING, BrakeWall, ImpactCap, Timing, brake_strengths
from tensionlab.model.files import load_rig
from tensionlab.model.kinematics import turn_axes
from tensionlab.model.rig import Rig
from tensionlab.scenarios.person import PersonPlan
from tensionlab.scenarios.placement import Similarity
from tensionlab.support.arrays import Floats
from tensionlab.support.files.named import is_path
from tensionlab.support.files.reading import as_path, brief, read_toml
from tensionlab.support.formatting import format_count, format_vector
from tensionlab.support.registry import suggest
from tensionlab.support.validation import describe, validate

FOLDER = Path(__file__).parent / "files"  # scenarios of this package: NAME.toml and NAME.rig.toml
SCALES = np.linspace(1.0, 0.5, 11)  # sizes of a placed scenario that are tried, the largest first
PATH_STEP_S = 0.02  # time between positions of the hand that the cables must hold
PositiveNumber = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
SCENARIOS = ("materials", "collision", "recoil", "weight", "bow")  # their names, in the order of the publication


@checked_dataclass(ScenarioError)
class BrakeTarget:
    """Surface at which brakes stop the hand or the head: a wall, or the end of a reach; exactly one of them."""

    force: PositiveForce
    """Force that the brakes hold, in N."""
    plane: Plane | None = None
    """Wall; its normal is towards the free side."""
    reach: Length | None = None
    """Largest distance, in m, from the origin of the frame of the effects."""
    cap: ImpactCap | None = None
    """Cap on the force of an impact, for what must not be hurt."""
    timing: Timing = TIMING
    """Timing of the brakes, to which the delay of the loop is added."""

    def __post_init__(self) -> None:
        if (self.plane is None) == (self.reach is None):
            raise ScenarioError("a hold has a plane or a reach: give one of them")

    def wall(self, position: Floats) -> BrakeWall:
        """Return the wall as seen from a position (d,)."""
        if self.plane is not None:
            return BrakeWall(self.plane.n, float(self.plane.height(position)), self.force)
        assert self.reach is not None
        inward = -normalized(position) if position.any() else np.eye(position.size)[0]
        return BrakeWall(inward, self.reach - float(norm(position)), self.force)


@checked_dataclass(ScenarioError)
class Phase:
    """Effects by name, and the brake target, between two times in s since the scenario began."""

    name: str
    begin: float
    end: float
    effects: Mapping[str, Any] = field(default_factory=dict)
    hold: BrakeTarget | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.begin < self.end < math.inf:
            raise ScenarioError(f'phase "{self.name}": begin {self.begin}, end {self.end}; give 0 <= begin < end')


@checked_dataclass(ScenarioError)
class Scenario:
    """Rig, person and phases of a scenario."""

    name: str
    title: str
    about: str
    rig: InstanceOf[Rig]
    """Rig of a point: the hand or the head."""
    person: PersonPlan
    """Simulated person, for runs without a real one."""
    phases: Annotated[tuple[Phase, ...], Field(min_length=1)]
    """Phases; overlapping ones are rendered together."""
    seconds: PositiveNumber
    """Duration, in s."""
    rate: PositiveNumber = 200.0
    """Rate of cycles, in Hz."""
    policy: Policy = "direction"
    """Policy for infeasible forces."""
    frame: str | None = None
    """Body frame in which effects and brake targets are; the world if None."""
    slew: float | None = None
    """Slew-rate limit that the modules need, in N/s; None: their default."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Names of the held point and the bodies in pictures."""
    feet: tuple[float, ...] | None = None
    """Point between the feet of the person, for pictures; None: no person is drawn."""
    up: str | None = None
    """Axis of the world that points up, for effects, scripts and rig."""
    placement: str = ""
    """How it was turned or placed for the rig; empty if it was not."""

    def __repr__(self) -> str:
        phases = format_count(len(self.phases), "phase")
        return f"<Scenario {self.name}: {phases} in {self.seconds:g} s on {self.rig.name}>"

    def __post_init__(self) -> None:
        rig, frames = self.rig, brief(sorted(self.rig.frames))
        rig.require_position("scenarios")
        if rig.n != rig.dimension:
            raise self._error(f'rig "{rig.name}" turns; give one of a point')
        if self.up is not None and self.up != rig.up:
            raise self._error(
                f'up is "{self.up}", but "{rig.up}" of rig "{rig.name}"; give a rig with the same up'
            )
        if set(rig.frames) - set(self.person.bodies):
            raise self._error(
                f"the person has the bodies {brief(sorted(self.person.bodies))}, "
                f"but modules are attached to {frames}; give a script for each of these"
            )
        if self.frame is not None and self.frame not in rig.frames:
            known = f"one of {frames}" if rig.frames else "a rig with modules that are attached to it"
            raise self._error(f'frame is "{self.frame:.40}", no body frame of rig "{rig.name}"; give {known}')
        for name, script in {"person": self.person.script, **self.person.bodies}.items():
            if (axes := len(script.waypoints[0].position)) != rig.dimension:
                raise self._error(
                    f'waypoints of "{name}" have {axes} coordinates; give {rig.dimension}, as the rig has axes'
                )
        if self.feet is not None and len(self.feet) != rig.dimension:
            raise self._error(f"feet is {brief(list(self.feet))}; give {rig.dimension} coordinates, in m")
        caps = [phase.hold.cap.force for phase in self.phases if phase.hold is not None and phase.hold.cap]
        # All cables together: the force of a brake is not measured.
        strongest = float((rig.limits.upper + brake_strengths(rig)).sum())
        if caps and strongest > min(caps):
            raise self._error(
                f'the motors and brakes of rig "{rig.name}" hold up to {strongest:g} N '
                f"together, and a hold's cap allows {min(caps):g} N; put breakaway links on the cables with "
                "brakes, and give the force at which they part as `brake` in the rig file"
            )
        named = [name for phase in self.phases for name in phase.effects]
        if len(set(named)) < len(named):
            raise self._error(f"the effects are {brief(named)}; give each its own name")

    def _error(self, problem: str) -> ScenarioError:
        return ScenarioError(f'scenario "{self.name}": {problem}')

    def active_phases(self, time: float) -> tuple[Phase, ...]:
        """Return the phases at a time in s."""
        return tuple(phase for phase in self.phases if phase.begin <= time < phase.end)

    def mapped(self, rig: Rig, similarity: Similarity, placement: str) -> Scenario:
        """Return the scenario in the axes of a rig; effects in the frame of a body are only turned."""
        rigid, origin = replace(similarity, scale=1.0), np.zeros(rig.dimension)
        surfaces = similarity if self.frame is None else replace(rigid, start=origin, at=origin)
        phases = []
        for phase in self.phases:
            effects = {name: surfaces.surfaces(effect, name) for name, effect in phase.effects.items()}
            hold = None if phase.hold is None else surfaces.surfaces(phase.hold, phase.name)
            if hold is not None and hold.reach is not None and np.any(surfaces.start != surfaces.at):
                raise self._error(
                    f'phase "{phase.name}" holds at a reach from the origin; give a plane to place it'
                )
            phases.append(replace(phase, effects=effects, hold=hold))
        feet = None if self.feet is None else rigid.point(self.feet)
        person = similarity.person(self.person)
        mapped: Scenario = replace(
            self, rig=rig, up=rig.up, person=person, phases=tuple(phases), feet=feet, placement=placement
        )
        return mapped


def load_scenario(
    name: str | PathLike[str],
    rig: str | PathLike[str] | None = None,
    at: ArrayLike | None = None,
    facing: ArrayLike | None = None,
) -> Scenario:
    """Return a scenario of this package, or from a file, in the axes of its rig.

    With ``at`` or ``facing`` it is placed where the hand is. Hand, bodies and person move and turn as a whole.
    Paths and surfaces are also scaled, by the largest of `SCALES` with which the cables hold the hand everywhere;
    materials, such as a stiffness or the period of ripples, and scenarios in a body's frame are not.

    Parameters
    ----------
    name : str or path
        One of `SCENARIOS`, or the path of a file: it ends in ``.toml`` or has a separator.
    rig : str or path, optional
        A rig, as `load_rig` takes it, in place of the scenario's own: that of its key ``rig``, or NAME.rig.toml
        next to NAME.toml. For one with another ``up`` the scenario is turned.
    at : (d,) array_like, optional
        Where the hand starts, in m, in the axes of the rig; its home if only ``facing`` is given.
    facing : (d,) array_like, optional
        Where the person faces, along the floor; left out: the axis after the one that is up.

    Raises
    ------
    ScenarioError
        Naming the file and the key: what is wrong and what to do; or the place that the rig does not reach.
    RigError
        If the rig's file is.

    Examples
    --------
    >>> from tensionlab.scenarios import load_scenario
    >>> bow = load_scenario("bow")
    >>> [phase.name for phase in bow.phases]
    ['draw', 'full draw']
    """
    path = as_path(name)
    if not is_path(name, ".toml"):
        if name not in SCENARIOS:
            advice = suggest(str(name), SCENARIOS, f"choose one of {', '.join(SCENARIOS)}.")
            raise ScenarioError(f"no scenario is called {brief(name)}; {advice} A path ends in .toml or has a '/'")
        path = FOLDER / f"{name}.toml"
    contents = read_toml(path, "a scenario file (*.toml)", ScenarioError)
    try:
        scenario, loaded = _scenario(contents, path, rig)
    except (ScenarioError, EffectError) as error:
        raise ScenarioError(f"{path}: {error}") from None
    if at is not None or facing is not None:
        return _placed(scenario, loaded, at, facing)
    if loaded.up == scenario.up:
        return scenario
    origin = np.zeros(loaded.dimension)
    turn = Similarity(turn_axes(scenario.rig.upward, loaded.upward), origin, origin)
    return scenario.mapped(loaded, turn, f'turned to have {loaded.up} up, as rig "{loaded.name}" has')


def _scenario(contents: dict[str, Any], path: Path, rig: str | PathLike[str] | None) -> tuple[Scenario, Rig]:
    """Return the scenario of a file in its own axes, and its rig; a path in its ``rig`` is from its folder."""
    if "up" not in contents:
        raise ScenarioError("up is missing; give the axis that points up")
    if unknown := contents.keys() & {"name", "placement"}:
        raise ScenarioError(f"{min(unknown)} is an unknown key; leave it out")
    named, phases = contents.pop("rig", None), contents.get("phases")
    if rig is not None:
        loaded = load_rig(rig)
    elif named is None:
        loaded = load_rig(path.with_suffix(".rig.toml"))
    elif not isinstance(named, str):
        raise ScenarioError(f"rig is {describe(named)}; give a text")
    else:
        try:
            loaded = load_rig(path.parent / named if is_path(named, ".toml") else named)
        except RigError as error:
            raise RigError(f'{path}: key "rig": {error}') from None
    if loaded.up is None:
        raise ScenarioError(f'rig "{loaded.name}": key "up" is missing; give the axis that points up')
    try:
        unturned = replace(loaded, up=contents["up"])  # the scenario is read in its own axes
    except RigError as error:
        raise ScenarioError(f'{error}, as rig "{loaded.name}" ({loaded.kind}) has them, or another rig') from None
    for phase in phases if isinstance(phases, list) else ():
        if isinstance(phase, dict) and isinstance(given := phase.get("effects"), dict):
            phase["effects"] = {name: parse_effect(name, effect, unturned) for name, effect in given.items()}
    scenario: Scenario = validate(Scenario, contents | {"name": path.stem, "rig": unturned}, ScenarioError)
    for phase in scenario.phases:
        if phase.hold is not None:
            require_dimension(phase.hold, loaded.dimension, f'phase "{phase.name}": hold')
    return scenario, loaded


def _placed(scenario: Scenario, rig: Rig, at: ArrayLike | None, facing: ArrayLike | None) -> Scenario:
    """Return the scenario where the hand is on a rig, as large as the cables hold it."""
    here = rig.home if at is None else np.asarray(at, dtype=np.float64)
    front = np.roll(np.abs(rig.upward), 1) if facing is None else np.asarray(facing, dtype=np.float64)
    if here.shape != rig.home.shape or front.shape != rig.home.shape:
        raise ScenarioError(f'at and facing have {rig.dimension} components on rig "{rig.name}"')
    level = front - (front @ rig.upward) * rig.upward
    if (size := float(np.linalg.norm(level))) < 1e-6:
        raise ScenarioError(f"facing {format_vector(front)} points up or down; give a direction along the floor")
    axes = (_axes(rig.upward, level / size), _axes(scenario.rig.upward, np.roll(np.abs(scenario.rig.upward), 1)))
    rotation, start = axes[0] @ axes[1].T, np.array(scenario.person.script.waypoints[0].position)
    text = f"placed at {format_vector(here)} m, facing {format_vector((level / size).round(2) + 0.0)}"
    sized, missed = text, here
    for scale in SCALES[:1] if scenario.frame is not None else SCALES:
        sized = text if scale == 1.0 else f"{text}, at {100.0 * scale:.0f} % of its size"
        placed = scenario.mapped(rig, Similarity(rotation, start, here, scale), sized)
        path, held = _held(placed)
        if held.all():
            return placed
        missed = path[int(np.argmin(held))]
    raise ScenarioError(
        f'scenario "{scenario.name}" does not fit: {sized}, the cables of rig "{rig.name}" do not hold the '
        f"hand at {format_vector(missed.round(2) + 0.0)} m; start elsewhere (the rig's home is "
        f"{format_vector(rig.home)} m), or give another rig"
    )


def _axes(up: Floats, ahead: Floats) -> Floats:
    """Return the axes ahead, aside and up as columns (d, d)."""
    return np.stack([ahead, up] if up.size == 2 else [ahead, np.cross(up, ahead), up], axis=1)


def _held(scenario: Scenario) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the path of the hand (K, d), and where the cables hold it: anywhere if not even at the rig's home."""
    rig, person, times = scenario.rig, scenario.person, np.arange(0.0, scenario.seconds, PATH_STEP_S)
    path, *bodies = (
        np.array([script.position(time) for time in times])
        for script in (person.script, *(person.bodies[name] for name in rig.frames))
    )
    nothing, home = rig.required.middle(rig), rig.structure_matrix(rig.home, frames=rig.at_rest)
    if rig.m <= rig.n or allocate(home, nothing, rig.limits).status != Status.EXACT:
        return path, np.ones(len(path), dtype=np.bool_)
    structure = rig.structure_matrix(path, frames=dict(zip(rig.frames, bodies, strict=True)))
    return path, allocate(structure, nothing, rig.limits).status == Status.EXACT
