"""Stability of late loops: bounds of stiffness, and the cap that keeps away from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import TypeVar

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import EffectError

T = TypeVar("T")

MARGIN = 0.5
"""Share of the bound that a host may use: a default of this project."""


def stiffness_bound(
    delay: float | Floats, step: float, hand_damping: float | Floats, damping: float | Floats = 0.0
) -> Floats:
    """Return up to which stiffness a hand against a spring does not shake, in N/m.

    ``K < (b + B)/(T/2 + t_d)``: a force held for a step T is on average T/2 late; a spring that is late by tau
    gives back ``K tau`` of negative damping, and the dampers have to make up for it. Exact for a heavy hand. For
    one of 0.3 kg and 30 ms it is 3 % too low without B, and 3 % too high where B is as large as b.

    Parameters
    ----------
    delay : array
        t_d, there and back, from the hand's motion to the force on it, in s.
    step : float
        T, for which a force is held, in s: the slowest of the loops on the way.
    hand_damping : array
        b of the hand, in N s/m.
    damping : array
        B of the effect, which is just as late, in N s/m.

    Notes
    -----
    After Colgate and Schenkel 1994, "Passivity of a class of sampled-data systems: application to haptic
    interfaces"; Gil, Sanchez, Hulin, Preusche and Hirzinger 2009, "Stability boundary for haptic rendering:
    influence of damping and delay".
    """
    if not step > 0.0:
        raise EffectError(f"stiffness bound: step is {step}; give the period of the loop, above 0, in s")
    for name, value in (("delay", delay), ("hand_damping", hand_damping), ("damping", damping)):
        if not (np.asarray(value) >= 0.0).all():
            raise EffectError(f"stiffness bound: {name} is {value}; give 0 or more")
    total: Floats = (np.asarray(hand_damping) + damping) / (step / 2 + np.asarray(delay))
    return total


def stiffness_cap(
    round_trips: float | Sequence[float] | Floats,
    step: float,
    hand_damping: float,
    damping: float = 0.0,
    margin: float = MARGIN,
) -> float:
    """Return how stiff the host may make an effect over a link, in N/m.

    Round trips are measured, in s, or a single one; the 99th percentile counts: shaking needs only a few periods
    to start. ``step`` is the period of the host's loop, or of the telemetry if that is longer, in s; dampings are
    as in `stiffness_bound`, of which the ``margin`` is a share.
    """
    trips = np.atleast_1d(np.asarray(round_trips, dtype=np.float64))
    if trips.size == 0 or not (np.isfinite(trips) & (trips >= 0.0)).all():
        raise EffectError(f"stiffness cap: round trips are {round_trips}; measure some, in s")
    late = float(np.percentile(trips, 99.0, method="higher"))
    return margin * float(stiffness_bound(late, step, hand_damping, damping))


def capped(effect: T, cap: float, spared: type | tuple[()] = ()) -> T:
    """Return an effect whose stiffness, and that of its parts, does not exceed a cap in N/m.

    Every parameter called stiffness counts: that of a wall, of a friction's bristle, of a coupling. Where a kind
    of effect is spared, its own stiffness stays, but not that of its parts.
    """
    changes: dict[str, object] = {}
    for each in fields(effect) if is_dataclass(effect) else ():
        value = getattr(effect, each.name)
        if each.name == "stiffness" and value > cap and not isinstance(effect, spared):
            changes[each.name] = cap
        elif is_dataclass(value) and (part := capped(value, cap, spared)) is not value:
            changes[each.name] = part
    return replace(effect, **changes) if changes else effect  # type: ignore[type-var]


def cut_stiffnesses(
    effect: object, cap: float, spared: type | tuple[()] = (), above: str = ""
) -> dict[str, float]:
    """Return the stiffnesses that `capped` cuts, by their names, as they were, in N/m.

    ``above`` is the name of what the effect is part of, with a dot.
    """
    found: dict[str, float] = {}
    for each in fields(effect) if is_dataclass(effect) else ():
        value = getattr(effect, each.name)
        if each.name == "stiffness" and value > cap and not isinstance(effect, spared):
            found[f"{above}stiffness"] = value
        elif is_dataclass(value):
            found |= cut_stiffnesses(value, cap, spared, f"{above}{each.name}.")
    return found
