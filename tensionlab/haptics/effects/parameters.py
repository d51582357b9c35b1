"""Parameters of effects: type, dimension, unit and physical range of each, stated once beside its name.

A parameter of a `Parameters` class is annotated with a type of this module, such as ``stiffness: Stiffness``;
`require_dimension` refuses vectors that are not of a rig's space; `tools.generate_bridge_docs` writes the ranges
into docs/reference/bridge.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, get_args, get_type_hints

from pydantic import Strict

from tensionlab.errors import EffectError, TensionlabError
from tensionlab.support.files.reading import brief

FAR_M = 100.0
"""Coordinates are between minus and plus this, in m."""
CLOCK_S = 1e7
"""Times on a run's clock are between minus and plus this, in s: 115 days."""
MAX_COUNT = 100
"""Numbers in a list, such as the shots of a recoil."""


@dataclass(frozen=True)
class Range:
    """Physical range of a number: both ends are allowed, but ``low`` where it must be positive; NaN never is."""

    unit: str
    low: float
    high: float
    positive: bool = False

    def allows(self, value: Any) -> bool:
        """Tell whether a value is a number of this range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return self.low <= value <= self.high and not (self.positive and value == self.low)

    def __str__(self) -> str:
        """Return the range in words, as messages and docs/reference/bridge.md have it."""
        if not math.isfinite(self.low):
            return f"a finite number, {self.high:g} {self.unit} or less, or leave it out"
        if not math.isfinite(self.high):
            return f"a finite number, {self.low:g} {self.unit} or more, or leave it out"
        low = f"above {self.low:g}, to" if self.positive else f"{self.low:g} to"
        return f"a finite number, {low} {self.high:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Vector:
    """Physical range of each component of a vector of the rig's dimension, and its least length.

    The default of one that is ``oriented`` holds where Z is up, and is turned for other rigs.
    """

    unit: str
    low: float
    high: float
    shortest: float = 0.0
    oriented: bool = False

    def allows(self, value: Any) -> bool:
        """Tell whether a value is a vector of this range."""
        inside = Range(self.unit, self.low, self.high)
        return (
            isinstance(value, tuple)
            and 0 < len(value) <= 3
            and all(inside.allows(each) for each in value)
            and math.hypot(*value) >= self.shortest
        )

    def __str__(self) -> str:
        """Return the range in words."""
        each = f"finite components, {self.low:g} to {self.high:g} {self.unit}".rstrip()
        return f"{each}, not all 0; its length does not matter" if self.shortest else each


@dataclass(frozen=True)
class Many:
    """A list of numbers of one range, `MAX_COUNT` at most."""

    each: Range

    def allows(self, value: Any) -> bool:
        """Tell whether a value is such a list."""
        return isinstance(value, tuple) and len(value) <= MAX_COUNT and all(map(self.each.allows, value))

    def __str__(self) -> str:
        """Return the range in words."""
        return f"at most {MAX_COUNT} finite numbers, {self.each.low:g} to {self.each.high:g} {self.each.unit}"


Bound = Range | Vector | Many
Number = Annotated[float, Strict()]
Components = tuple[Number, ...]

Stiffness = Annotated[Number, Range("N/m", 0.0, 1e6)]
PositiveStiffness = Annotated[Number, Range("N/m", 0.0, 1e6, positive=True)]
Damping = Annotated[Number, Range("N s/m", 0.0, 1e3)]
PositiveDamping = Annotated[Number, Range("N s/m", 0.0, 1e4, positive=True)]
QuadraticDamping = Annotated[Number, Range("N s²/m²", 0.0, 1e3)]
Force = Annotated[Number, Range("N", 0.0, 1e3)]
PositiveForce = Annotated[Number, Range("N", 0.0, 1e3, positive=True)]
Mass = Annotated[Number, Range("kg", 0.0, 100.0)]
PositiveMass = Annotated[Number, Range("kg", 0.0, 100.0, positive=True)]
Length = Annotated[Number, Range("m", 1e-4, FAR_M)]
LengthOrNone = Annotated[Number, Range("m", 0.0, FAR_M)]
Time = Annotated[Number, Range("s", -CLOCK_S, CLOCK_S)]
TimeOrEver = Annotated[Number, Range("s", -math.inf, CLOCK_S)]
TimeOrNever = Annotated[Number, Range("s", -CLOCK_S, math.inf)]
Duration = Annotated[Number, Range("s", 1e-4, CLOCK_S)]
Frequency = Annotated[Number, Range("Hz", 1e-3, 1e4)]
ModuleFrequency = Annotated[Number, Range("Hz", 1e-3, 500.0)]
"""Of a vibration: modules refuse more."""
Rate = Annotated[Number, Range("1/s", 1e-3, 100.0)]
Acceleration = Annotated[Number, Range("m/s²", 0.0, 1e3)]
Share = Annotated[Number, Range("", 0.0, 1.0)]
FrictionCoefficient = Annotated[Number, Range("", 0.0, 10.0)]
Point = Annotated[Components, Vector("m", -FAR_M, FAR_M)]
Edges = Annotated[Components, Vector("m", 1e-4, FAR_M)]
Direction = Annotated[Components, Vector("", -1e6, 1e6, shortest=1e-6, oriented=True)]
Gravity = Annotated[Components, Vector("m/s²", -100.0, 100.0, oriented=True)]
Times = Annotated[Components, Many(Range("s", -CLOCK_S, CLOCK_S))]


def bounds(kind: type) -> dict[str, Bound]:
    """Return the ranges of a class's parameters, by their names; those without one are left out."""
    return _bounds(kind)


@cache
def _bounds(kind: type) -> dict[str, Bound]:
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        for option in (hint, *get_args(hint)):  # also that of "a number, or None"
            for each in getattr(option, "__metadata__", ()):
                if isinstance(each, Bound):
                    found[name] = each
    return found


class Parameters:
    """Base of dataclasses whose annotated parameters are checked as they are made.

    A parameter outside its physical range raises ``refusal``, which names the class and the parameter; None is a
    parameter that is left out.
    """

    refusal: ClassVar[type[TensionlabError]] = EffectError

    def __post_init__(self) -> None:
        for name, bound in bounds(type(self)).items():
            value = getattr(self, name)
            if value is not None and not bound.allows(value):
                raise self.refusal(f"{type(self).__name__}: {name} is {brief(value)}; give {bound}")


def require_dimension(owner: object, dimension: int, where: str) -> None:
    """Raise `EffectError` for vectors, also those of parts and of defaults, that are not of a rig's space."""
    for name, vector in _vectors(owner):
        if len(vector) != dimension:
            raise EffectError(
                f"{where}: {name} is {brief(vector)}; give {dimension} components, as the rig has {dimension} axes"
            )


def _vectors(owner: object) -> Iterator[tuple[str, tuple[float, ...]]]:
    for name, bound in bounds(type(owner)).items():
        if isinstance(bound, Vector) and getattr(owner, name) is not None:
            yield name, getattr(owner, name)
    for part in fields(owner) if is_dataclass(owner) else ():
        value = getattr(owner, part.name)
        if is_dataclass(value):
            yield from ((f"{part.name}.{name}", vector) for name, vector in _vectors(value))
