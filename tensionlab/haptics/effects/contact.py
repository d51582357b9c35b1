"""What does a flat surface feel like: a wall, or a magnet?

A plane has a point and a normal n that points out of it, towards the free side. The height of a hand above it is
``h = n·(p - point)``, its penetration ``d = -h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Memory, Motion, Rendered, along, dot
from tensionlab.haptics.effects.on_module import AxisImpedance
from tensionlab.haptics.effects.parameters import (
    Damping,
    Direction,
    Length,
    Point,
    PositiveForce,
    PositiveStiffness,
    Stiffness,
    require_parameters,
)

ORIGIN = (0.0, 0.0, 0.0)
UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Plane:
    """Where is a flat surface, and which way is out of it?

    Parameters
    ----------
    point : tuple of d floats
        Any point of it, in m.
    normal : tuple of d floats
        Out of it; its length does not matter.
    """

    point: Point = ORIGIN
    normal: Direction = UP

    def __post_init__(self) -> None:
        require_parameters(self)

    @cached_property
    def n(self) -> Floats:
        """The unit normal (d,)."""
        return along(np.asarray(self.normal, dtype=np.float64))

    def height(self, position: Floats) -> Floats:
        """How far above it is a position (..., d), in m? Negative inside."""
        return dot(position - np.asarray(self.point), self.n)


@dataclass(frozen=True)
class Wall:
    """What does a wall feel like? A spring and a damper that only push.

    ``F = n max(0, K d - B n·v)`` where the penetration d > 0, else 0. Continuous in the position for a hand at
    rest; one that comes in at the speed s meets a step of ``B s``. Passive. All of it runs on a module: over a
    link of 20 ms only some 50 N/m are stable (Colgate and Schenkel 1994, "Passivity of a class of sampled-data
    systems").

    Parameters
    ----------
    plane : Plane
    stiffness : float
        K in N/m. 300, on the module, is a default of this project.
    damping : float
        B in N s/m; 2 is a default of this project.
    """

    plane: Plane = Plane()
    stiffness: Stiffness = 300.0
    damping: Damping = 2.0

    def __post_init__(self) -> None:
        require_parameters(self)

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Push, in contact."""
        return Rendered(self.push(motion)[..., None] * self.plane.n)

    def push(self, motion: Motion) -> Floats:
        """How hard does it push along its normal, in N?"""
        depth = -self.plane.height(motion.position)
        push = self.stiffness * depth - self.damping * dot(motion.velocity, self.plane.n)
        return np.where(depth > 0.0, np.maximum(push, 0.0), 0.0)

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """All of it, along the normal; the module's damper does not act on the way out."""
        depth = -float(self.plane.height(motion.position))
        return AxisImpedance(self.plane.n, depth, self.stiffness, self.damping)

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Nothing."""
        return Rendered(np.zeros_like(motion.position))


@dataclass(frozen=True)
class Magnet:
    """What does a magnetic surface feel like? It draws the hand near, and holds it at the surface.

    At the distance h: towards the surface, ``K h`` for ``h < h_1``, else ``F_1 (h_max - h)/(h_max - h_1)``, and
    nothing beyond h_max, with ``h_1 = F_max/K`` and ``F_1 = F_max``; where K is too small for that (capped, say),
    ``h_1 = h_max/2`` and ``F_1 = K h_1``. Inside, ``K |h|`` pushes out: an addition of this project, as is that
    the damping ``-b v`` fades with the force beyond h_1. Continuous. Passive. The profile is that of CHAI3D's
    magnetic effect (Conti et al. 2003, "The CHAI libraries").

    Parameters
    ----------
    plane : Plane
    max_force : float
        F_max in N; 3 is a default of this project.
    reach : float
        h_max in m; 0.10 is a default of this project.
    stiffness : float
        K in N/m; the wall's 300 is a default of this project.
    damping : float
        b in N s/m; 1 is a default of this project.
    """

    plane: Plane = Plane()
    max_force: PositiveForce = 3.0
    reach: Length = 0.10
    stiffness: PositiveStiffness = 300.0
    damping: Damping = 1.0

    def __post_init__(self) -> None:
        require_parameters(self)

    @property
    def peak(self) -> float:
        """At which distance does it pull most, in m?"""
        return min(self.max_force / self.stiffness, self.reach / 2)

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Pull towards the surface, and damp."""
        height = self.plane.height(motion.position)
        spring = self.stiffness * np.minimum(height, self.peak)
        pull = spring * self._fade(height)
        damping = self.damping * self._fade(height)
        return Rendered(-pull[..., None] * self.plane.n - damping[..., None] * motion.velocity)

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """The spring, along the normal, from the side where the hand is; further away, the pull as it is now."""
        height = float(self.plane.height(motion.position))
        if height >= self.reach:
            return None
        if height < self.peak:
            axis = self.plane.n * (-1.0 if height > 0.0 else 1.0)
            return AxisImpedance(axis, abs(height), self.stiffness, self.damping)
        return AxisImpedance(
            -self.plane.n, feed_forward=self.stiffness * self.peak * float(self._fade(np.asarray(height)))
        )

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """The damping beyond the spring."""
        height = self.plane.height(motion.position)
        damping = np.where(height < self.peak, 0.0, self.damping * self._fade(height))
        return Rendered(-damping[..., None] * motion.velocity)

    def _fade(self, height: Floats) -> Floats:
        return np.clip((self.reach - height) / (self.reach - self.peak), 0.0, 1.0)
