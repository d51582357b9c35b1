"""Effects from messages: a kind, and parameters by their names."""

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
    require_known(f"effect {name!r}", EFFECTS[kind], parameters)
    try:
        effect: Effect = adapter(kind).validate_python(parameters)
    except ValidationError as error:
        problem = error.errors()[0]
        where = "".join(f"{step}: " for step in problem["loc"])
        raise EffectError(f"effect {name!r}: {where}{problem['msg'].removeprefix('Value error, ')}") from None
    return effect


def _solid(where: str, given: Mapping[str, Any]) -> Any:
    """Which solid has a client described: its kind, and its parameters?"""
    kind = given.get("kind", "sphere")
    if kind not in SOLIDS:
        raise EffectError(f"{where}: kind is {kind!r}; give one of {', '.join(SOLIDS)}")
    parameters = {key: value for key, value in given.items() if key != "kind"}
    require_known(where, SOLIDS[kind], parameters)
    try:
        return TypeAdapter(SOLIDS[kind]).validate_python(parameters)
    except ValidationError as error:
        raise EffectError(f"{where}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None


@cache
def adapter(kind: str) -> TypeAdapter[Any]:
    """How are the parameters of a kind of effect read?"""
    return TypeAdapter(EFFECTS[kind])


def require_known(where: str, hint: Any, given: Any) -> None:
    """Refuse keys that a class, or one that it holds, does not have: a table for each class.

    Raises
    ------
    EffectError
        Naming the key.
    """
    if is_dataclass(hint) and isinstance(given, Mapping):
        hints = get_type_hints(hint)
        names = [each.name for each in fields(hint)]
        for key, value in given.items():
            if key not in names:
                raise EffectError(f"{where}: no parameter {key!r}; there are {', '.join(names)}")
            require_known(f"{where}: {key}", hints[key], value)
    elif get_origin(hint) is tuple and isinstance(given, Sequence):
        for value in given:
            require_known(where, get_args(hint)[0], value)
    elif get_origin(hint) is Mapping and isinstance(given, Mapping):
        for name, value in given.items():
            require_known(f"{where}: {name}", get_args(hint)[1], value)
    elif len(inner := [each for each in get_args(hint) if is_dataclass(each)]) == 1:
        require_known(where, inner[0], given)
