"""Types of parameters: the range of each, its unit, and what its vectors are."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Annotated, Any, TypeVar, dataclass_transform, get_origin

import pydantic.dataclasses
from pydantic import AfterValidator, ConfigDict, Field, Strict

from tensionlab.errors import EffectError, TensionlabError
from tensionlab.support.files.reading import brief
from tensionlab.support.validation import raises

T = TypeVar("T")
FAR_M = 100.0  # largest coordinate, in m
CLOCK_S = 1e7  # largest time on a run's clock, in s: 115 days
MAX_COUNT = 100  # largest number of entries in a list, such as the shots of a recoil
MIN_DIRECTION = 1e-6  # smallest length of a vector that states a direction


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Field))
def checked_dataclass(error: type[TensionlabError]) -> Callable[[type[T]], type[T]]:
    """Make a class a frozen dataclass whose constructor raises an error for parameters outside their range.

    Strings below the parameters are their descriptions, in messages and in the JSON schema.
    """
    config = ConfigDict(extra="forbid", use_attribute_docstrings=True, arbitrary_types_allowed=True)

    def decorate(kind: type[T]) -> type[T]:
        checked: Any = pydantic.dataclasses.dataclass(frozen=True, config=config)(kind)
        return raises(error)(checked)

    return decorate


@dataclasses.dataclass(frozen=True)
class Vector:
    """Mark of a parameter with one component per axis of the rig.

    The default of an ``oriented`` one is stated for Z up, and turned for other rigs.
    """

    oriented: bool = False


def _unit(name: str) -> Any:
    return Field(json_schema_extra={"unit": name})


def _require_direction(value: tuple[float, ...]) -> tuple[float, ...]:
    if math.hypot(*value) < MIN_DIRECTION:
        raise ValueError(f"{brief(value)} has no direction; give components that are not all 0")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]

Stiffness = Annotated[Number, Field(ge=0.0, le=1e6), _unit("N/m")]
PositiveStiffness = Annotated[Number, Field(gt=0.0, le=1e6), _unit("N/m")]
Damping = Annotated[Number, Field(ge=0.0, le=1e3), _unit("N s/m")]
PositiveDamping = Annotated[Number, Field(gt=0.0, le=1e4), _unit("N s/m")]
QuadraticDamping = Annotated[Number, Field(ge=0.0, le=1e3), _unit("N s²/m²")]
Force = Annotated[Number, Field(ge=0.0, le=1e3), _unit("N")]
PositiveForce = Annotated[Number, Field(gt=0.0, le=1e3), _unit("N")]
Mass = Annotated[Number, Field(ge=0.0, le=100.0), _unit("kg")]
PositiveMass = Annotated[Number, Field(gt=0.0, le=100.0), _unit("kg")]
Length = Annotated[Number, Field(ge=1e-4, le=FAR_M), _unit("m")]
NonNegativeLength = Annotated[Number, Field(ge=0.0, le=FAR_M), _unit("m")]
Time = Annotated[Number, Field(ge=-CLOCK_S, le=CLOCK_S), _unit("s")]
PastTime = Annotated[float, Strict(), Field(le=CLOCK_S), _unit("s")]
FutureTime = Annotated[float, Strict(), Field(ge=-CLOCK_S), _unit("s")]
Duration = Annotated[Number, Field(ge=1e-4, le=CLOCK_S), _unit("s")]
Frequency = Annotated[Number, Field(ge=1e-3, le=1e4), _unit("Hz")]
ModuleFrequency = Annotated[Number, Field(ge=1e-3, le=500.0), _unit("Hz")]
Rate = Annotated[Number, Field(ge=1e-3, le=100.0), _unit("1/s")]
Acceleration = Annotated[Number, Field(ge=0.0, le=1e3), _unit("m/s²")]
Share = Annotated[Number, Field(ge=0.0, le=1.0)]
FrictionCoefficient = Annotated[Number, Field(ge=0.0, le=10.0)]
Times = Annotated[tuple[Time, ...], Field(max_length=MAX_COUNT), _unit("s")]

Axes = Field(min_length=1, max_length=3)
Coordinate = Annotated[Number, Field(ge=-FAR_M, le=FAR_M)]
Component = Annotated[Number, Field(ge=-1e6, le=1e6)]
Point = Annotated[tuple[Coordinate, ...], Axes, _unit("m"), Vector()]
Edges = Annotated[tuple[Length, ...], Axes, _unit("m"), Vector()]
Direction = Annotated[
    tuple[Component, ...],
    Axes,
    AfterValidator(_require_direction),
    Field(json_schema_extra={"contains": {"not": {"const": 0}}}),
    Vector(oriented=True),
]
Gravity = Annotated[
    tuple[Annotated[Number, Field(ge=-100.0, le=100.0)], ...], Axes, _unit("m/s²"), Vector(oriented=True)
]


def vectors(kind: Any) -> dict[str, Vector]:
    """Return the marks of a class's vectors, by the names of the parameters."""
    marks = {
        name: [mark for mark in info.metadata if isinstance(mark, Vector)]
        for name, info in getattr(kind, "__pydantic_fields__", {}).items()
    }
    return {name: mark[0] for name, mark in marks.items() if mark}


def list_names(kind: Any) -> list[str]:
    """Return the names of a class's parameters that are lists but not vectors."""
    known = vectors(kind)
    fields = getattr(kind, "__pydantic_fields__", {})
    return [name for name, info in fields.items() if get_origin(info.annotation) is tuple and name not in known]


def require_dimension(parameters: object, dimension: int, where: str) -> None:
    """Raise `EffectError` for a vector of another dimension than a rig's, also in parts and defaults."""
    for name, vector in _vector_values(parameters):
        if len(vector) != dimension:
            raise EffectError(f"{where}: {name} is {brief(vector)}; give {dimension} components on this rig")


def _vector_values(parameters: Any) -> Iterator[tuple[str, tuple[float, ...]]]:
    for name in vectors(type(parameters)):
        yield name, getattr(parameters, name)
    for part in dataclasses.fields(parameters):
        value = getattr(parameters, part.name)
        if dataclasses.is_dataclass(value):
            yield from ((f"{part.name}.{name}", vector) for name, vector in _vector_values(value))
