"""Stability of late loops: bounds of stiffness, the cap that keeps below them, and the passivity controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects.effect import Motion, dot, is_split
from tensionlab.support.arrays import Floats

T = TypeVar("T")

MARGIN = 0.5  # share of the bound that a host may use: a default of this project
# Allowed share of the damping `m/(T/2 + t_d)`: a late damper oscillates at about pi/2 of that (our default).
DAMPING_SHARE = 0.8

# Of what the forces on their way take while the hand goes against them: so much it may get back by turning round
# before the host knows. A default of this project: at 0 a wall of three times the bound gives too much once over
# 20 and 30 ms; at 1 also a stable one is rendered as damped, from 5 ms on.
TURNING_SHARE = 0.25


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
    late = float(np.sort(trips, axis=None)[math.ceil(0.99 * (trips.size - 1))])
    return margin * float(stiffness_bound(late, step, hand_damping, damping))


def capped(effect: T, cap: float, *, host_side: bool = False) -> T:
    """Return an effect whose stiffness, and that of its parts, does not exceed a cap in N/m.

    Every parameter called stiffness counts: that of a wall, of a friction's bristle, of a coupling. On the
    ``host_side`` of a split effect its own stiffness, which a module renders, stays, but not that of its parts.
    """
    changes: dict[str, object] = {}
    for each in fields(effect) if is_dataclass(effect) else ():
        value = getattr(effect, each.name)
        if each.name == "stiffness" and value > cap and not (host_side and is_split(effect)):
            changes[each.name] = cap
        elif is_dataclass(value) and (part := capped(value, cap, host_side=host_side)) is not value:
            changes[each.name] = part
    return replace(effect, **changes) if changes else effect  # type: ignore[type-var]


def cut_stiffnesses(effect: object, cap: float, above: str = "", *, host_side: bool = False) -> dict[str, float]:
    """Return the stiffnesses that `capped` cuts, by their names, as they were, in N/m.

    ``above`` is the name of what the effect is part of, with a dot.
    """
    found: dict[str, float] = {}
    for each in fields(effect) if is_dataclass(effect) else ():
        value = getattr(effect, each.name)
        if each.name == "stiffness" and value > cap and not (host_side and is_split(effect)):
            found[f"{above}stiffness"] = value
        elif is_dataclass(value):
            found |= cut_stiffnesses(value, cap, f"{above}{each.name}.", host_side=host_side)
    return found


def max_damping(mass: float, delay: float, step: float) -> float:
    """Return how much a late damper may damp, in N s/m: ``0.8 m/(T/2 + t_d)``.

    A damper that is late by tau and a mass m shake where its damping is above ``pi/2 m/tau``. m is the lightest
    hand that there may be, in kg; t_d the delay there and back, and T the step for which a force is held, in s.
    """
    if not (mass > 0.0 and delay >= 0.0 and step > 0.0):
        raise EffectError(
            f"max damping: mass {mass}, delay {delay}, step {step}; give them above 0, the delay 0 or more"
        )
    return DAMPING_SHARE * mass / (step / 2 + delay)


class Observed(NamedTuple):
    """Memory of the observer.

    ``energy`` (...) in J is what the loop has taken from the hand, less what it gave; ``position`` (..., d) is
    that of the step before; ``forces`` are commanded, and not yet at the hand as far as is known, the oldest
    first.
    """

    energy: Floats
    position: Floats
    forces: tuple[Floats, ...]


class Corrected(NamedTuple):
    """Force (..., d) to command in N, damping (...) that was added in N s/m, and what to remember."""

    force: Floats
    damping: Floats
    memory: Observed


@dataclass(frozen=True)
class PassivityController:
    """Passivity controller: adds a damper to the desired force where energy would come out of nowhere.

    The observer adds up ``E_k = E_k-1 - F_k-1·dp``. A force acts on the hand as late as the host sees the hand,
    so each dp is taken with the force that was commanded a round trip ago. Where the forces that are on their way
    would make E negative, at the present velocity or with a hand that turns round, a damper is added: ``F - alpha
    v`` with ``alpha = min(-E/(T |v|²), alpha_max)``. What it takes is observed with the rest, so E needs no
    correction. A surplus is forgotten where nothing acts: it would let the loop give out as much later.

    With a delay the damper comes late and E may dip, by no more than the hand's own 2 N s/m make up for, up to
    three times the bound of stiffness and 30 ms. The price: over 20 ms, a hand of 0.3 m/s meets a wall of half the
    bound with twice the force.

    After Hannaford and Ryu 2002, "Time-domain passivity control of haptic interfaces", with no delay, which look
    one step ahead; the pairing with the round trip and the look at what is on its way are this project's own.

    Parameters
    ----------
    max_damping : float
        alpha_max in N s/m, see `max_damping`.
    delay : int
        Round trip, in steps.
    """

    max_damping: float
    delay: int = 0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.max_damping) and self.max_damping >= 0.0):
            raise EffectError(
                f"PassivityController: max_damping is {self.max_damping}; give a damping in N s/m, 0 or more"
            )
        if self.delay < 0 or self.delay != int(self.delay):
            raise EffectError(f"PassivityController: delay is {self.delay}; give a number of steps, 0 or more")

    def correct(self, force: Floats, motion: Motion, memory: Observed | None = None) -> Corrected:
        """Return the force to command now in place of the desired one, (..., d) in N."""
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
