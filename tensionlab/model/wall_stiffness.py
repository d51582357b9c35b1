"""Stiffness of a wall against the hand: by the host's loop, and by a module along its cable."""

from __future__ import annotations

import math

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.support.arrays import Floats

MARGIN = 0.5  # share of the bound that a host may use (our default)
HAND_DAMPING = 2.0  # b of a hand that holds something, in N s/m: a default of this project
MIN_HAND_MASS_KG = 0.3  # smallest effective mass of a hand: a default of this project
CYCLE_S, LATENCY_S = 1.0 / 50.0, 0.02  # period and delay of the loop before it is measured: the runner's default
MODULE_STIFFNESS = 500.0  # largest stiffness of the firmware's impedance, in N/m
MIN_COSINE = math.cos(math.radians(45.0))  # between axis and cable: published threshold of a convincing direction
LEAST_MODULE_STIFFNESS = MODULE_STIFFNESS * MIN_COSINE**2  # of a cable that may render a wall at all, in N/m


def stiffness_bound(
    delay: float | Floats, step: float, hand_damping: float | Floats, damping: float | Floats = 0.0
) -> Floats:
    """Return the stiffness below which a hand against a spring is stable, in N/m.

    ``K < (b + B)/(T/2 + t_d)``: a force held for a step T is T/2 late on average; a spring that is late by tau has
    the negative damping ``K tau``, for which the dampers must make up. Exact for a heavy hand. For 0.3 kg and 30
    ms it is 3 % too low without B, and 3 % too high if B is as large as b.

    ``delay`` is t_d, there and back, from the hand's motion to the force on it, in s; ``step`` is T, for which a
    force is held, in s: the slowest of the loops on the way; ``hand_damping`` b and the effect's ``damping`` B,
    which is just as late, are in N s/m.

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


def host_stiffness(step: float = CYCLE_S, delay: float = LATENCY_S) -> float:
    """Return the stiffest wall that the host renders in a loop of a period and a delay, both in s, in N/m."""
    return MARGIN * float(stiffness_bound(delay, step, HAND_DAMPING))


def module_stiffness(directions: Floats, normals: Floats) -> Floats:
    """Return the stiffest wall that one module renders along each normal, (..., k), in N/m.

    ``directions`` (..., m, d) are unit vectors from the hand along the cables, ``normals`` (k, d) those along
    which a wall pushes the hand. A cable at cosine c to the normal renders ``c²`` of its module's stiffness. Where
    c is below `MIN_COSINE` the host renders the wall instead.
    """
    cosines = np.einsum("...md,kd->...km", directions, normals).max(axis=-1)
    return np.asarray(MODULE_STIFFNESS * np.square(cosines.clip(min=0.0)))
