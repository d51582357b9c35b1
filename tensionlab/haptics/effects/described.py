"""Effects from files and messages: a kind, and parameters by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.effect import Effect
from tensionlab.haptics.effects.parameters import Vector, bounds, require_dimension
from tensionlab.haptics.effects.refusal import first_problem, shown
from tensionlab.haptics.effects.tools import Weight
from tensionlab.model.kinematics import turn_axes
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief

Z_UP = np.array([0.0, 0.0, 1.0])
"""As the defaults of effects have it."""


def effect_of(name: str, given: object, rig: Rig) -> Effect:
    """Return the effect that a client or a file describes, by its ``kind`` and parameters.

    Those left out have their default, turned with what is up: weights pull down and walls lie flat by the rig's
    ``up``. The rig's space has as many axes as all vectors components. Raise `EffectError`, naming the effect and
    the parameter.
    """
    where = f"effect {name!r}"
    kind, parameters = _kind(where, given, EFFECTS)
    written = dict(parameters)
    if isinstance(solid := parameters.get("field"), Mapping):
        shape, edges = _kind(f"{where}: field", {"kind": "sphere", **solid}, SOLIDS)
        parameters["field"] = read(f"{where}: field", shape, edges)
    if kind is Weight and rig.up is None and "gravity" not in written:
        raise EffectError(f'{where}: rig "{rig.name}": key "up" is missing; give gravity, in m/s², or that key')
    effect: Effect = read(where, kind, parameters)
    if rig.up not in (None, "z"):
        up = rig.upward
        effect = _turned(effect, written, turn_axes(Z_UP, up) if up.size == 3 else np.outer(up, Z_UP))
    require_dimension(effect, rig.dimension, where)
    return effect


def prepare() -> None:
    """Make the readers of all effects: made with the first message of a kind, they would hold up a cycle."""
    for kind in (*EFFECTS.values(), *SOLIDS.values()):
        _adapter(kind)


def _turned(part: Any, written: object, rotation: Floats) -> Any:
    """Return an effect, or a part of one, with those of its directions turned that no table gives."""
    table = written if isinstance(written, Mapping) else {}
    changed = {}
    for name, bound in bounds(type(part)).items():
        if isinstance(bound, Vector) and bound.oriented and name not in table:
            turned = rotation @ np.array(getattr(part, name)) + 0.0  # no minus zero
            if turned.any():  # in the plane, what is level has no place
                changed[name] = tuple(turned.tolist())
    for each in fields(part):
        value = getattr(part, each.name)
        if is_dataclass(value):
            changed[each.name] = _turned(value, table.get(each.name), rotation)
    return replace(part, **changed)


def _kind(where: str, given: object, known: Mapping[str, type]) -> tuple[type, dict[str, Any]]:
    """Return the class that a table names by its kind, and the rest of the table."""
    if not isinstance(given, Mapping):
        raise EffectError(f"{where} is {brief(given)}; give a table with its kind and parameters")
    if "kind" not in given:
        raise EffectError(f"{where}: kind is missing; give one of {', '.join(known)}")
    kind = given["kind"]
    if not isinstance(kind, str) or kind not in known:
        raise EffectError(f"{where}: kind is {shown(kind)}; give one of {', '.join(known)}")
    return known[kind], {key: value for key, value in given.items() if key != "kind"}


def read(where: str, hint: Any, given: Any) -> Any:
    """Return what a table, or a value, of a file or a message describes; ``hint`` is the type that it should be.

    Raise `EffectError`, beginning with ``where`` and naming the key.
    """
    _require_known(where, hint, given)
    try:
        return _adapter(hint).validate_python(given)
    except ValidationError as error:
        wanted = _wanted(hint, error.errors(include_url=False)[0]["loc"])
        raise EffectError(f"{where}: {first_problem(error, wanted=wanted)}") from None


def _wanted(hint: Any, way: Sequence[int | str]) -> str:
    """Return the range of the parameter that a way through classes leads to, in words; empty if it has none."""
    for step in way:
        key, hints = str(step), get_type_hints(hint) if is_dataclass(hint) else {}
        if key not in hints:
            return ""
        bound, hint = bounds(hint).get(key), hints[key]
        if bound is not None:
            return str(bound)
    return ""


@cache
def _adapter(hint: Any) -> TypeAdapter[Any]:
    return TypeAdapter(hint)


def _require_known(where: str, hint: Any, given: Any) -> None:
    """Refuse keys that a class, or one that it holds, does not have: a table for each class."""
    if is_dataclass(hint) and isinstance(given, Mapping):
        hints = get_type_hints(hint)
        names = [each.name for each in fields(hint)]
        for key, value in given.items():
            if key not in names:
                raise EffectError(f"{where}: no parameter {brief(key)}; there are {', '.join(names)}")
            _require_known(f"{where}: {key}", hints[key], value)
    elif get_origin(hint) is tuple and isinstance(given, Sequence):
        for value in given:
            _require_known(where, get_args(hint)[0], value)
    elif get_origin(hint) is Mapping and isinstance(given, Mapping):
        for name, value in given.items():
            _require_known(f"{where}: {name}", get_args(hint)[1], value)
    elif len(inner := [each for each in get_args(hint) if is_dataclass(each)]) == 1:
        _require_known(where, inner[0], given)
