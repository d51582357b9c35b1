"""Effects from files and messages: a kind, and parameters by their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import EFFECTS
from tensionlab.haptics.effects.effect import Effect
from tensionlab.haptics.effects.parameters import require_dimension, vectors
from tensionlab.haptics.effects.shape import take_kind
from tensionlab.haptics.effects.tools import Weight
from tensionlab.model.kinematics import turn_axes
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.validation import validate

Z_UP = np.array([0.0, 0.0, 1.0])  # direction up for which the defaults of effects are stated


def parse_effect(name: str, table: object, rig: Rig) -> Effect:
    """Return the effect that a client or a file describes, by its ``kind`` and parameters.

    Those left out have their default, turned with what is up: weights pull down and walls lie flat by the rig's
    ``up``. Raise `EffectError`, naming the effect and the parameter.
    """
    where = f"effect {name!r}"
    try:
        kind, parameters = take_kind(table, EFFECTS)
    except ValueError as error:
        raise EffectError(f"{where}: {error}") from None
    if kind is Weight and rig.up is None and "gravity" not in parameters:
        raise EffectError(f'{where}: rig "{rig.name}": key "up" is missing; give gravity, in m/s², or that key')
    effect: Effect = validate(kind, parameters, EffectError, where)
    if rig.up not in (None, "z"):
        up = rig.upward
        effect = _turn_defaults(effect, parameters, turn_axes(Z_UP, up) if up.size == 3 else np.outer(up, Z_UP))
    require_dimension(effect, rig.dimension, where)
    return effect


def _turn_defaults(part: Any, written: object, rotation: Floats) -> Any:
    """Return an effect, or a part of one, with those of its directions turned that no table gives."""
    table = written if isinstance(written, Mapping) else {}
    changed = {}
    for name, vector in vectors(type(part)).items():
        if vector.oriented and name not in table:
            turned = rotation @ np.array(getattr(part, name)) + 0.0  # no minus zero
            if turned.any():  # a level direction has no counterpart in the plane
                changed[name] = tuple(turned.tolist())
    for each in fields(part):
        value = getattr(part, each.name)
        if is_dataclass(value):
            changed[each.name] = _turn_defaults(value, table.get(each.name), rotation)
    return replace(part, **changed)
