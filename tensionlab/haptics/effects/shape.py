"""What does a solid of any shape feel like? A spring to a proxy that stays on its surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Memory, Motion, Rendered, along, dot, length_of
from tensionlab.haptics.effects.fields import Field, Sphere
from tensionlab.haptics.effects.on_module import AxisImpedance
from tensionlab.haptics.effects.parameters import Damping, Stiffness, require_parameters

STEPS = 10
"""Of the proxy at most, each time; a slow hand needs two or three. What is left of the way it goes next time."""
NEAR = 1e-6
"""Within so many m of the surface a proxy is on it; a step as short ends its way."""
CLOSE = 1e-3
"""Within so many m of the surface a proxy goes straight on, and only not in."""


@dataclass(frozen=True)
class VirtualCoupling:
    """What ties the hand to a proxy? A spring and a damper: ``F = K_c (proxy - p) - B_c v``.

    Whatever holds the proxy, the hand feels no more than K_c and B_c; so they alone decide whether it is stable
    (Colgate, Stanley and Brown 1995, "Issues in the haptic display of tool use").

    Parameters
    ----------
    stiffness : float
        K_c in N/m; 400 is a default of this project.
    damping : float
        B_c in N s/m; 0.
    """

    stiffness: Stiffness = 400.0
    damping: Damping = 0.0

    def __post_init__(self) -> None:
        require_parameters(self)

    def force(self, motion: Motion, proxy: Floats) -> Floats:
        """Which force (..., d) acts on the hand, in N?"""
        return self.stiffness * (proxy - motion.position) - self.damping * motion.velocity


class Proxy(NamedTuple):
    """Where is the proxy (..., d), does it touch the surface (...), and which way is out there (..., d)?"""

    position: Floats
    touching: NDArray[np.bool_]
    normal: Floats


@dataclass(frozen=True)
class Shape:
    """What does a solid of any shape feel like? A spring to a proxy that follows the hand but stays outside.

    ``F = K (proxy - p) - B v`` while the proxy touches, else 0. The proxy is a god-object (Zilles and Salisbury
    1995, "A constraint-based god-object method for haptic display"): it goes towards the hand, at most as far at a
    time as it is from the surface, and slides along where it would go in; so a hand that has gone through a thin
    plate is still drawn back to the side where it came from. At first it is the point of the surface to which the
    field leads. Continuous in the position of a hand at rest, but where a proxy slides off an edge. Passive: the
    proxy only ever comes nearer to the hand by itself.

    Parameters
    ----------
    field : callable
        Signed distance field, see `tensionlab.haptics.effects.fields`. What it is of may be round or square, not
        rough: it should be correct to a micrometre at the surface.
    coupling : VirtualCoupling
        K and B. All of it runs on a module, as a wall that touches the shape at the proxy.
    """

    field: Field = field(default_factory=Sphere)
    coupling: VirtualCoupling = VirtualCoupling()

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Push the hand towards the proxy; the memory is where the proxy is."""
        proxy = self.follow(motion.position, memory)
        force = np.where(proxy.touching[..., None], self.coupling.force(motion, proxy.position), 0.0)
        return Rendered(force, proxy.position)

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """A wall at the proxy; where it does not touch, at the nearest point of the surface."""
        proxy = self.follow(motion.position, memory)
        if proxy.touching:
            depth = float(dot(proxy.position - motion.position, proxy.normal))
        else:
            depth = -float(self.field(motion.position)[0])
        return AxisImpedance(proxy.normal, depth, self.coupling.stiffness, self.coupling.damping)

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Nothing, but the proxy goes on."""
        return Rendered(np.zeros_like(motion.position), self.follow(motion.position, memory).position)

    def follow(self, position: Floats, before: Floats | None) -> Proxy:
        """Where does the proxy go, if it was there before and the hand is here?

        Parameters
        ----------
        position : (..., d) array
            Of the hand, in m.
        before : (..., d) array or None
            None: it begins where the hand is, or where the field leads out from there.
        """
        proxy = self._outside(position) if before is None else before
        for _ in range(STEPS):
            distance, normal = self.field(proxy)
            way = position - proxy
            inward = np.minimum(dot(way, normal) + distance, 0.0)
            # At the surface: straight on, but not into it. Above it: no further than is surely free, which close
            # to the surface is so little that the proxy of a hand that skims it would be left behind.
            free = way * np.minimum(1.0, distance / np.maximum(length_of(way), NEAR))[..., None]
            step = np.where((distance <= CLOSE)[..., None], way - inward[..., None] * normal, free)
            ahead = self._outside(proxy + step)
            # In a corner it would go to and fro: it only ever comes nearer, by more than a hair.
            nearer = length_of(position - ahead) < length_of(way) - NEAR**2
            proxy = np.where(nearer[..., None], ahead, proxy)
            if not (nearer & (length_of(step) > NEAR)).any():
                break
        distance, normal = self.field(proxy)
        touching = (distance <= 2 * NEAR) & (dot(position - proxy, normal) < 0.0)
        return Proxy(proxy, touching, normal)

    def _outside(self, position: Floats) -> Floats:
        for _ in range(3):
            distance, normal = self.field(position)
            if (distance >= 0.0).all():
                break
            position = position - np.minimum(distance, 0.0)[..., None] * along(normal)
        return position
