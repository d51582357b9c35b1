"""Scenarios: a rig, a person, effects and brake targets by phase; read from TOML by name or path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, InstanceOf

from tensionlab.allocation import Policy
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
from tensionlab.support.arrays import Floats
from tensionlab.support.files.named import is_path
from tensionlab.support.files.reading import as_path, brief, read_toml
from tensionlab.support.formatting import format_count
from tensionlab.support.registry import suggest
from tensionlab.support.validation import describe, validate

FOLDER = Path(__file__).parent / "files"  # scenarios of this package: NAME.toml and NAME.rig.toml
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

    def delayed_timing(self, delay: float) -> Timing:
        """Return the brakes' timing over a loop with a delay in s."""
        return replace(self.timing, latency=self.timing.latency + delay)


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
    """How the rig was turned from the axes of its file, or the scenario placed on it; empty if neither."""

    def __repr__(self) -> str:
        phases = format_count(len(self.phases), "phase")
        return f"<Scenario {self.name}: {phases} in {self.seconds:g} s on {self.rig.name}>"

    def __post_init__(self) -> None:
        rig, frames = self.rig, brief(sorted(self.rig.frames))
        if rig.n != rig.dimension:
            raise self._error(f'rig "{rig.name}" turns; give one of a point')
        if self.up is not None and self.up != rig.up:
            its = 'no key "up"' if rig.up is None else f'up = "{rig.up}"'
            raise self._error(
                f'it has up = "{self.up}", and rig "{rig.name}" {its}; give a rig whose file '
                f'says up = "{self.up}", with its anchors in those axes'
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


def load_scenario(name: str | PathLike[str], rig: str | PathLike[str] | None = None) -> Scenario:
    """Return a scenario of this package, or from a file.

    Parameters
    ----------
    name : str or path
        One of `SCENARIOS`, or the path of a file: it ends in ``.toml`` or has a separator.
    rig : str or path, optional
        A rig, as `load_rig` takes it, in place of the scenario's own: that of its key ``rig``, or NAME.rig.toml
        next to NAME.toml. A rig with another ``up`` is turned by `Rig.with_up_axis`.

    Raises
    ------
    ScenarioError
        Naming the file and the key: what is wrong and what to do.
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
        return _scenario(contents, path, rig)
    except (ScenarioError, EffectError) as error:
        raise ScenarioError(f"{path}: {error}") from None


def _scenario(contents: dict[str, Any], path: Path, rig: str | PathLike[str] | None) -> Scenario:
    """Return the scenario of a file; ``rig`` in it is a rig, by name, or by file in the same folder."""
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
    loaded, turned = _with_up_axis(loaded, contents["up"])
    for phase in phases if isinstance(phases, list) else ():
        if isinstance(phase, dict) and isinstance(given := phase.get("effects"), dict):
            phase["effects"] = {name: parse_effect(name, effect, loaded) for name, effect in given.items()}
    whole = contents | {"name": path.stem, "rig": loaded, "placement": turned}
    scenario: Scenario = validate(Scenario, whole, ScenarioError)
    for phase in scenario.phases:
        if phase.hold is not None:
            require_dimension(phase.hold, loaded.dimension, f'phase "{phase.name}": hold')
    return scenario


def _with_up_axis(rig: Rig, up: str) -> tuple[Rig, str]:
    """Return the rig turned to an ``up``, and a sentence about it; an empty one if it was not turned."""
    if rig.up is None or rig.up == up:
        return rig, ""
    try:
        turned = rig.with_up_axis(up)
    except RigError as error:
        raise ScenarioError(f'{error}, as rig "{rig.name}" ({rig.kind}) has them, or another rig') from None
    axes = []
    for row in turn_axes(rig.upward, turned.upward):
        index = int(np.abs(row).argmax())
        axes.append("-" * int(row[index] < 0) + "xyz"[index])
    names = ", ".join("xyz"[: rig.dimension])
    return turned, f'rig "{rig.name}" has {rig.up} up and is turned: its {", ".join(axes)} are {names} here'
