"""Effects from files and messages: a kind, and parameters by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.effect import Effect


def effect_of(name: str, given: Mapping[str, Any]) -> Effect:
    """Which effect has a client described?

    Parameters
    ----------
    name : str
        What the client calls it.
    given : mapping
        ``kind``, and parameters of that effect; those left out have their default.

    Raises
    ------
    EffectError
        Naming the effect and the parameter: what is wrong and what to do.
    """
    kind = given.get("kind")
    if kind not in EFFECTS:
        raise EffectError(f"effect {name!r}: kind is {kind!r}; give one of {', '.join(EFFECTS)}")
    parameters = {key: value for key, value in given.items() if key != "kind"}
    if isinstance(solid := parameters.get("field"), Mapping):
        parameters["field"] = _solid(f"effect {name!r}: field", solid)
    effect: Effect = read(f"effect {name!r}", EFFECTS[kind], parameters)
    return effect


def _solid(where: str, given: Mapping[str, Any]) -> Any:
    """Which solid has a client described: its kind, and its parameters?"""
    kind = given.get("kind", "sphere")
    if kind not in SOLIDS:
        raise EffectError(f"{where}: kind is {kind!r}; give one of {', '.join(SOLIDS)}")
    parameters = {key: value for key, value in given.items() if key != "kind"}
    return read(where, SOLIDS[kind], parameters)


def read(where: str, hint: Any, given: Any) -> Any:
    """What does a table, or a value, of a file or a message describe? ``hint`` is the type that it should be.

    Raises
    ------
    EffectError
        Beginning with ``where``, and naming the key.
    """
    _require_known(where, hint, given)
    try:
        return _adapter(hint).validate_python(given)
    except ValidationError as error:
        problem = error.errors()[0]
        step = "".join(f"{each}: " for each in problem["loc"])
        raise EffectError(f"{where}: {step}{problem['msg'].removeprefix('Value error, ')}") from None


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
                raise EffectError(f"{where}: no parameter {key!r}; there are {', '.join(names)}")
            _require_known(f"{where}: {key}", hints[key], value)
    elif get_origin(hint) is tuple and isinstance(given, Sequence):
        for value in given:
            _require_known(where, get_args(hint)[0], value)
    elif get_origin(hint) is Mapping and isinstance(given, Mapping):
        for name, value in given.items():
            _require_known(f"{where}: {name}", get_args(hint)[1], value)
    elif len(inner := [each for each in get_args(hint) if is_dataclass(each)]) == 1:
        _require_known(where, inner[0], given)
