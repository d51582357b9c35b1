"""Effects from files and messages: a kind, and parameters by their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import EFFECTS
from tensionlab.haptics.effects.ambient import Weight
from tensionlab.haptics.effects.effect import Effect
from tensionlab.haptics.effects.parameters import require_dimension, vectors
from tensionlab.model.kinematics import turn_axes
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.validation import take_kind, validate

Z_UP = np.array([0.0, 0.0, 1.0])  # direction up for which the defaults of effects are stated


def parse_effect(name: str, table: object, rig: Rig) -> Effect:
    """Return the effect that a client or a file describes, by its ``kind`` and parameters.

    Directions that are left out are turned with the rig's ``up``: weights pull down and walls lie flat. Raise
    `EffectError`, naming the effect and the parameter.
    """
    where = f"effect {name!r}"
    try:
        kind, parameters = take_kind(table, EFFECTS)
    except ValueError as error:
        raise EffectError(f"{where}: {error}") from None
    if kind is Weight and rig.up is None and "gravity" not in parameters:
        raise EffectError(f'{where}: rig "{rig.name}": key "up" is missing; give gravity, in m/s², or that key')
    if rig.up not in (None, "z"):
        up = rig.upward
        rotation = turn_axes(Z_UP, up) if up.size == 3 else np.outer(up, Z_UP)
        parameters = _with_turned_defaults(kind(), parameters, rotation)
    effect: Effect = validate(kind, parameters, EffectError, where)
    require_dimension(effect, rig.dimension, where)
    return effect


def _with_turned_defaults(default: Any, table: Any, rotation: Floats) -> Any:
    """Return a table with the directions that it leaves out, turned; also in its parts."""
    if not isinstance(table, Mapping):
        return table
    completed = dict(table)
    for name, vector in vectors(type(default)).items():
        if vector.oriented and name not in table:
            turned = rotation @ np.array(getattr(default, name)) + 0.0  # no minus zero
            if turned.any():  # a level direction has no counterpart in the plane
                completed[name] = tuple(turned.tolist())
    for field in fields(default):
        part, written = getattr(default, field.name), table.get(field.name, {})
        if is_dataclass(part):
            completed[field.name] = _with_turned_defaults(part, written, rotation)
    return completed
