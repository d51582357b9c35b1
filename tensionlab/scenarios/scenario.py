"""What is a scenario? A rig, a person, and what is to be felt when."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from tensionlab.allocation import Nearest
from tensionlab.errors import ScenarioError
from tensionlab.files.reading import brief
from tensionlab.haptics.brakes.choice import brake_strengths
from tensionlab.haptics.brakes.contact import ImpactCap
from tensionlab.haptics.effects.effect import Effect
from tensionlab.model.rig import Rig
from tensionlab.scenarios.brake_target import Hold
from tensionlab.scenarios.person import PersonPlan


@dataclass(frozen=True)
class Phase:
    """What is to be felt from one time to another?

    Parameters
    ----------
    name : str
    begin, end : float
        In s since the scenario began.
    effects : mapping of str to Effect
        By any names.
    hold : Hold or None
        What brakes are to hold against.
    """

    name: str
    begin: float
    end: float
    effects: Mapping[str, Effect] = field(default_factory=dict)
    hold: Hold | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.begin < self.end < math.inf:
            raise ScenarioError(f'phase "{self.name}": begin {self.begin}, end {self.end}; give 0 <= begin < end')


@dataclass(frozen=True, eq=False)
class Scenario:
    """What is played?

    Attributes
    ----------
    name, title, about : str
    rig : Rig
        Of a point: the hand or the head.
    person : PersonPlan
        Who is simulated, where no real person is.
    phases : tuple of Phase
        Those whose time it is are felt together.
    seconds : float
        How long it takes.
    rate : float
        Cycles a second.
    nearest : str
        What to render out of reach.
    seen_from : str or None
        Body frame from whose origin effects and holds see the hand; the world's if None.
    slew : float or None
        How fast the modules' tensions must be able to change, in N/s; None: as they come.
    labels : mapping of str to str
        What to call the held point and the bodies in pictures.
    stands : tuple of floats or None
        Between the feet of the person, for pictures; None: no person is drawn.
    up : str or None
        Axis of the world that points up, for which effects and scripts are meant. A rig with another is refused.
    """

    name: str
    title: str
    about: str
    rig: Rig
    person: PersonPlan
    phases: tuple[Phase, ...]
    seconds: float
    rate: float = 200.0
    nearest: Nearest = "direction"
    seen_from: str | None = None
    slew: float | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    stands: tuple[float, ...] | None = None
    up: str | None = None

    def __post_init__(self) -> None:
        rig, given = self.rig, set(self.person.bodies)
        if rig.n != rig.dimension:
            raise ScenarioError(f'scenario "{self.name}": rig "{rig.name}" turns; give one of a point')
        if self.up is not None and self.up != rig.up:
            its = 'no key "up"' if rig.up is None else f'up = "{rig.up}"'
            raise ScenarioError(
                f'scenario "{self.name}" has up = "{self.up}", and rig "{rig.name}" {its}; give a rig whose file '
                f'says up = "{self.up}", with its anchors in those axes'
            )
        if given != set(rig.frames):
            raise ScenarioError(
                f'scenario "{self.name}": the person has the bodies {brief(sorted(given))}, but modules ride on '
                f"{brief(sorted(rig.frames))}; give a script for each of these"
            )
        if self.seen_from is not None and self.seen_from not in rig.frames:
            raise ScenarioError(
                f'scenario "{self.name}": seen_from is "{self.seen_from:.40}"; '
                f"give one of {brief(sorted(rig.frames))}"
            )
        if not self.phases:
            raise ScenarioError(f'scenario "{self.name}" has no phases; give at least one')
        for name, script in {"person": self.person.script, **self.person.bodies}.items():
            if (given_axes := len(script.waypoints[0].position)) != rig.dimension:
                raise ScenarioError(
                    f'scenario "{self.name}": waypoints of "{name}" have {given_axes} coordinates; give '
                    f"{rig.dimension}, as the rig has axes"
                )
        if not (0.0 < self.rate < math.inf and 0.0 < self.seconds < math.inf):
            raise ScenarioError(
                f'scenario "{self.name}": seconds {self.seconds}, rate {self.rate}; give both above 0'
            )
        if self.stands is not None and len(self.stands) != rig.dimension:
            raise ScenarioError(
                f'scenario "{self.name}": stands is {brief(list(self.stands))}; '
                f"give {rig.dimension} coordinates, in m"
            )
        for phase in self.phases:
            if phase.hold is not None and phase.hold.cap is not None:
                self._require_gentle(phase.hold.cap)
        named = [name for phase in self.phases for name in phase.effects]
        if len(set(named)) < len(named):
            raise ScenarioError(f'scenario "{self.name}": the effects are {brief(named)}; give each its own name')

    def _require_gentle(self, cap: ImpactCap) -> None:
        """Refuse cables that could together pull harder than is allowed: a brake's force is not measured."""
        most = float((self.rig.limits.upper + brake_strengths(self.rig)).sum())
        if most > cap.force:
            raise ScenarioError(
                f'scenario "{self.name}": the motors and brakes of rig "{self.rig.name}" hold up to {most:g} N '
                f"together, and a hold's cap allows {cap.force:g} N; put breakaway links on the cables with "
                "brakes, and give the force at which they part as `brake` in the rig file"
            )

    def now(self, time: float) -> tuple[Phase, ...]:
        """Which phases are on, at a time in s?"""
        return tuple(phase for phase in self.phases if phase.begin <= time < phase.end)
