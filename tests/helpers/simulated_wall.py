"""Simulated stiffness limit of a wall: one hand, one wall and a delayed loop; many at a time.

The hand is a mass with damping that is pushed against the wall by a constant force. It moves exactly between the
steps (the force is constant meanwhile), so what the simulation finds is due to the loop alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import EffectError
from tensionlab.haptics.effects.parameters import Damping, PositiveMass, checked_dataclass
from tensionlab.model.wall_stiffness import stiffness_bound
from tensionlab.support.arrays import Floats

# Which force (...) acts on a hand at a position (...) with a velocity (...), at a step? As the host sees them.
Law = Callable[[int, Floats, Floats], Floats]


@checked_dataclass(EffectError)
class Hand:
    """Mass in kg, damping in N s/m and constant push in N, which may differ between hands (...)."""

    mass: PositiveMass = 0.3
    damping: Damping = 2.0
    push: float | Floats = 2.0


@dataclass(frozen=True, eq=False)
class Track:
    """Position in m and velocity in m/s at the begin of each step, force in N: arrays (steps, ...)."""

    position: Floats
    velocity: Floats
    force: Floats
    step: float

    def energy(self) -> Floats:
        """Return the energy in J that the wall has taken by each step; a passive wall never gives any."""
        moved = np.diff(self.position, axis=0)
        return np.cumsum(-self.force[:-1] * moved, axis=0)


def simulate(
    law: Law,
    delays: NDArray[np.int64],
    position: Floats,
    velocity: Floats,
    hand: Hand | None = None,
    step: float = 0.001,
    seconds: float = 4.0,
) -> Track:
    """Simulate hands against a wall, the space below zero, whose law sees the motion `delays` steps late.

    Before the begin the hand had been at its position at rest.
    """
    hand = hand or Hand()
    count = round(seconds / step)
    shape = np.broadcast_shapes(np.shape(delays), np.shape(position), np.shape(velocity))
    kept = np.exp(-hand.damping * step / hand.mass)
    mobility = (1.0 - kept) / hand.damping
    drift = mobility * hand.mass
    p, v, f = (np.empty((count, *shape)) for _ in range(3))
    now, speed = np.broadcast_to(position, shape), np.broadcast_to(velocity, shape)
    which, delays = np.indices(shape), np.broadcast_to(delays, shape)
    for k in range(count):
        p[k], v[k] = now, speed
        past = k - delays
        seen = (np.maximum(past, 0), *which)
        f[k] = law(k, p[seen], np.where(past >= 0, v[seen], 0.0))
        pull = f[k] - hand.push
        now = now + drift * speed + (step - drift) / hand.damping * pull
        speed = kept * speed + mobility * pull
    return Track(p, v, f, step)


def measured_bound(
    delays: Floats, damping: float = 0.0, hand: Hand | None = None, step: float = 0.001, seconds: float = 12.0
) -> Floats:
    """Return the largest stiffness in N/m that does not shake, for round trips in s and a wall's damping in N s/m.

    Each is tried on a grid of ratios to the predicted bound, 1 % apart, beginning a little off the rest point.
    """
    hand = hand or Hand()
    steps = np.rint(delays / step).astype(np.int64)[:, None]
    tried = stiffness_bound(np.multiply(steps, step, dtype=np.float64), step, hand.damping, damping) * np.arange(
        0.7, 1.7, 0.01
    )
    rest = -hand.push / tried

    def wall(_: int, position: Floats, velocity: Floats) -> Floats:
        return np.where(position < 0.0, np.maximum(-tried * position - damping * velocity, 0.0), 0.0)

    track = simulate(wall, steps, rest * 1.001, np.zeros_like(rest), hand, step, seconds)
    off = np.abs(track.position - rest)
    grows = off[-len(off) // 3 :].max(axis=0) > off[0]
    first = np.argmax(grows, axis=1)
    if not (grows.any(axis=1) & (first > 0)).all():
        raise RuntimeError("the bound is outside the ratios tried, 0.7 to 1.7")
    found: Floats = np.take_along_axis(tried, first[:, None], axis=1)[:, 0]
    return found
