"""Stability of late loops: bounds of stiffness, the cap that keeps below them, and the passivity controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import Field

from tensionlab.errors import EffectError
from tensionlab.haptics.effects.effect import Motion, dot, is_split
from tensionlab.haptics.effects.parameters import Number, checked_dataclass
from tensionlab.model.wall_stiffness import MARGIN, stiffness_bound
from tensionlab.support.arrays import Floats

T = TypeVar("T")
Side = Literal["both", "host", "module"]

# Allowed share of the damping `m/(T/2 + t_d)`; a late damper oscillates at about pi/2 of it (our default).
DAMPING_SHARE = 0.8
# Share of the energy that forces in transit take from the hand which it may get back by turning round (our
# default). At 0 a wall of three times the bound gives too much over 20 and 30 ms; at 1 a stable one is damped from
# 5 ms on.
TURNING_SHARE = 0.25


def stiffness_cap(
    round_trips: float | Sequence[float] | Floats,
    step: float,
    hand_damping: float,
    damping: float = 0.0,
    margin: float = MARGIN,
) -> float:
    """Return the largest stiffness of effects that the host renders over a link, in N/m.

    It is the ``margin``, a share, of `stiffness_bound` at the 99th percentile of the measured round trips in s,
    since shaking needs only a few periods to start. ``step`` is the period of the host's loop, or of the telemetry
    if that is longer, in s.
    """
    trips = np.atleast_1d(np.asarray(round_trips, dtype=np.float64))
    if trips.size == 0 or not (np.isfinite(trips) & (trips >= 0.0)).all():
        raise EffectError(f"stiffness cap: round trips are {round_trips}; measure some, in s")
    late = float(np.sort(trips, axis=None)[math.ceil(0.99 * (trips.size - 1))])
    return margin * float(stiffness_bound(late, step, hand_damping, damping))


def stiffnesses(effect: object, side: Side = "both") -> dict[str, float]:
    """Return the parameters of an effect called stiffness, in N/m, by name, such as ``friction.stiffness``.

    A module renders the own stiffness of a split effect; the host renders the others.
    """
    stiffness_by_name: dict[str, float] = {}
    kind: Any = type(effect)
    for name in _field_names(kind):
        value = getattr(effect, name)
        part: Any = type(value)
        if name == "stiffness":
            if side == "both" or is_split(effect) is (side == "module"):
                stiffness_by_name[name] = value
        elif _field_names(part):
            for inner, stiffness in stiffnesses(value, side).items():
                stiffness_by_name[f"{name}.{inner}"] = stiffness
    return stiffness_by_name


def cap_stiffness(effect: T, cap: float, side: Side = "both") -> tuple[T, dict[str, float]]:
    """Return an effect whose `stiffnesses` do not exceed a cap in N/m, and those that were above it."""
    cut = {name: stiffness for name, stiffness in stiffnesses(effect, side).items() if stiffness > cap}
    capped: Any = effect
    for name in cut:
        capped = _with_parameter(capped, name, cap)
    return capped, cut


def _with_parameter(effect: Any, name: str, value: float) -> Any:
    part, _, inner = name.partition(".")
    return replace(effect, **{part: _with_parameter(getattr(effect, part), inner, value) if inner else value})


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()


def max_damping(mass: float, delay: float, step: float) -> float:
    """Return the largest damping of a late damper, ``0.8 m/(T/2 + t_d)`` in N s/m.

    A damper that is late by tau and a mass m are unstable above ``pi/2 m/tau``. m is the mass of the lightest hand
    in kg; t_d the delay there and back, and T the step for which a force is held, in s.
    """
    return DAMPING_SHARE * mass / (step / 2 + delay)


class Observed(NamedTuple):
    """Memory of the observer.

    ``energy`` (...) in J is the energy that the loop has taken from the hand, less what it gave; ``position``
    (..., d) is the previous one; ``forces`` are commanded and in transit, the oldest first.
    """

    energy: Floats
    position: Floats
    forces: tuple[Floats, ...]


class Corrected(NamedTuple):
    """Force (..., d) to command in N, added damping (...) in N s/m, and memory."""

    force: Floats
    damping: Floats
    memory: Observed


@checked_dataclass(EffectError)
class PassivityController:
    """Passivity controller: adds a damper to the desired force if the loop would give energy.

    The observer adds up ``E_k = E_k-1 - F_k-1·dp``. A force acts on the hand as late as the host sees the hand, so
    each dp is paired with the force that was commanded a round trip ago. If the forces in transit would make E
    negative, at the present velocity or with a hand that turns round, a damper is added: ``F - alpha v`` with
    ``alpha = min(-E/(T |v|²), alpha_max)``. The energy that it takes is observed with the rest, so E needs no
    correction. A surplus is dropped while no force acts: later the loop could give it out.

    With a delay the damper is late and E may dip, by no more than the hand's own 2 N s/m dissipate, up to three
    times the bound of stiffness and 30 ms. The price: over 20 ms, a hand of 0.3 m/s meets a wall of half the bound
    with twice the force.

    After Hannaford and Ryu 2002, "Time-domain passivity control of haptic interfaces", with no delay, which look
    one step ahead; the pairing with the round trip and the forecast of forces in transit are this project's own.
    """

    max_damping: Annotated[Number, Field(ge=0.0)]
    """Largest damping alpha_max, in N s/m, see `max_damping`."""
    delay: Annotated[int, Field(ge=0)] = 0
    """Round trip, in steps."""

    def correct(self, force: Floats, motion: Motion, memory: Observed | None = None) -> Corrected:
        """Return the force to command instead of the desired one, (..., d) in N."""
        if memory is None:
            nothing = (np.zeros_like(motion.position),) * (self.delay + 1)
            memory = Observed(np.zeros(motion.position.shape[:-1]), motion.position, nothing)
        energy = memory.energy - dot(memory.forces[0], motion.position - memory.position)
        coming = np.sum(memory.forces[1:], axis=0) + force
        idle = ~(coming.any(axis=-1) | memory.forces[0].any(axis=-1))
        energy = np.where(idle, np.minimum(energy, 0.0), energy)
        given = motion.step * dot(coming, motion.velocity)
        foreseen = energy - np.maximum(given, -TURNING_SHARE * given)
        per_damping = motion.step * dot(motion.velocity, motion.velocity)
        needed = np.maximum(-foreseen, 0.0) / np.where(per_damping > 0.0, per_damping, 1.0)
        damping = np.where(per_damping > 0.0, np.minimum(needed, self.max_damping), 0.0)
        corrected = force - damping[..., None] * motion.velocity
        return Corrected(corrected, damping, Observed(energy, motion.position, (*memory.forces[1:], corrected)))
