"""Effects of flat surfaces: walls, magnets, dry friction and textures.

A plane has a point and a normal n that points out of it, towards the free side. The height of a hand above it is
``h = n·(p - point)``, its penetration ``d = -h``.
"""

from __future__ import annotations

import math
from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import parameters
from tensionlab.haptics.effects.effect import AxisImpedance, Memory, Motion, Rendered, dot, norm, normalized
from tensionlab.support.arrays import Floats

ORIGIN = (0.0, 0.0, 0.0)
UP = (0.0, 0.0, 1.0)


@parameters.checked_dataclass(EffectError)
class Plane:
    """Flat surface."""

    point: parameters.Point = ORIGIN
    """Any point of it, in m."""
    normal: parameters.Direction = UP
    """Direction out of it."""

    @cached_property
    def n(self) -> Floats:
        """The unit normal (d,)."""
        return normalized(np.asarray(self.normal, dtype=np.float64))

    def height(self, position: Floats) -> Floats:
        """Return the height of positions (..., d) above it, in m; negative inside."""
        return dot(position - np.asarray(self.point), self.n)


@parameters.checked_dataclass(EffectError)
class Wall:
    """Flat wall: a spring and a damper that only push.

    ``F = n max(0, K d - B n·v)`` where the penetration d > 0, else 0. Continuous in the position for a hand at
    rest; a hand that enters at the speed s meets a step of ``B s``. Passive. All of it runs on a module: over a
    link of 20 ms only some 50 N/m are stable (Colgate and Schenkel 1994, "Passivity of a class of sampled-data
    systems").
    """

    plane: Plane = Plane()
    stiffness: parameters.Stiffness = 300.0
    """Stiffness K of the spring, in N/m."""
    damping: parameters.Damping = 2.0
    """Damping B on the way in, in N s/m."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the push, in contact."""
        return Rendered(self.push(motion)[..., None] * self.plane.n)

    def push(self, motion: Motion) -> Floats:
        """Return the size of the push along the normal, in N."""
        depth = -self.plane.height(motion.position)
        push = self.stiffness * depth - self.damping * dot(motion.velocity, self.plane.n)
        return np.where(depth > 0.0, np.maximum(push, 0.0), 0.0)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance:
        """Return the whole wall, along the normal; the module's damper does not act on the way out."""
        depth = -float(self.plane.height(motion.position))
        return AxisImpedance(self.plane.n, depth, self.stiffness, self.damping)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return no force."""
        return Rendered(np.zeros(motion.position.shape))


@parameters.checked_dataclass(EffectError)
class Magnet:
    """Magnetic surface, which attracts the hand and holds it.

    At the distance h it pulls with ``K h`` for ``h < h_1``, with ``F_1 (h_max - h)/(h_max - h_1)`` up to h_max,
    and not beyond; ``h_1 = F_max/K`` and ``F_1 = F_max``, or ``h_1 = h_max/2`` and ``F_1 = K h_1`` where K is too
    small for that. The profile is that of CHAI3D's magnetic effect (Conti et al. 2003, "The CHAI libraries").
    Additions of this project: inside, ``K |h|`` pushes out; the damping ``-b v`` fades with the force beyond h_1.
    Continuous. Passive.
    """

    plane: Plane = Plane()
    max_force: parameters.PositiveForce = 3.0
    """Largest pull F_max, in N."""
    reach: parameters.Length = 0.10
    """Distance h_max at which the pull begins, in m."""
    stiffness: parameters.PositiveStiffness = 300.0
    """Stiffness K at the surface, in N/m."""
    damping: parameters.Damping = 1.0
    """Damping b, in N s/m."""

    @property
    def peak(self) -> float:
        """Distance of the largest pull, in m."""
        return min(self.max_force / self.stiffness, self.reach / 2)

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the pull towards the surface, and the damping."""
        height = self.plane.height(motion.position)
        spring = self.stiffness * np.minimum(height, self.peak)
        pull = spring * self._fade(height)
        damping = self.damping * self._fade(height)
        return Rendered(-pull[..., None] * self.plane.n - damping[..., None] * motion.velocity)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Return the spring along the normal, from the hand's side; further away, the current pull."""
        height = float(self.plane.height(motion.position))
        if height >= self.reach:
            return None
        if height < self.peak:
            axis = self.plane.n * (-1.0 if height > 0.0 else 1.0)
            reach = self.peak - height if height > 0.0 else math.inf
            return AxisImpedance(axis, abs(height), self.stiffness, self.damping, reach=reach)
        pull = self.stiffness * self.peak * float(self._fade(np.asarray(height)))
        return AxisImpedance(-self.plane.n, feed_forward=pull)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the damping beyond the spring."""
        height = self.plane.height(motion.position)
        damping = np.where(height < self.peak, 0.0, self.damping * self._fade(height))
        return Rendered(-damping[..., None] * motion.velocity)

    def _fade(self, height: Floats) -> Floats:
        return np.clip((self.reach - height) / (self.reach - self.peak), 0.0, 1.0)


class Bristle(NamedTuple):
    """Memory of friction: previous position, stretch z of the bristle, in m, and whether it slides."""

    position: Floats
    stretch: Floats
    sliding: NDArray[np.bool_]


@parameters.checked_dataclass(EffectError)
class Friction:
    """Dry friction: a bristle that holds the hand, and gives way when pulled too hard.

    Implicit return mapping (Kikuuwe, Takesue, Sano, Mochiyama and Fujimoto 2006, "Admittance and impedance
    representations of friction based on implicit Euler integration"), for a displacement dp in a step of length T:
    ``z* = z + dp``, ``f* = s0 z* + s1 (z* - z)/T``; if ``|f*| > F_c`` it slides, ``f = F_c f*/|f*|`` and
    ``z = (f + s1 z/T)/(s0 + s1/T)``, else it sticks, ``f = f*`` and ``z = z*``. The force on the hand is -f.
    F_c is ``mu_s F_n`` while it sticks and ``mu_d F_n`` while it slides. Passive, exactly so with the force at the
    end of each step: ``f·dp`` is at least the increase of ``s0/2 |z|²``. Jumps by ``(mu_s - mu_d) F_n`` when it
    begins to slide.
    """

    load: parameters.Force = 1.0
    """Normal force F_n, in N, of friction that is no part of a texture."""
    static: parameters.FrictionCoefficient = 0.5
    """Friction coefficient mu_s while it sticks."""
    dynamic: parameters.FrictionCoefficient = 0.35
    """Friction coefficient mu_d while it slides."""
    stiffness: parameters.PositiveStiffness = 400.0
    """Stiffness s0 of the bristle, in N/m."""
    damping: parameters.Damping = 2.0
    """Damping s1 of the bristle, in N s/m."""

    def __post_init__(self) -> None:
        if self.dynamic > self.static:
            raise EffectError(f"dynamic is {self.dynamic}, above static, {self.static}; give dynamic <= static")

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the friction under its own load, in every direction."""
        return self.rub(motion, np.full(motion.position.shape[:-1], self.load), None, memory)

    def rub(self, motion: Motion, load: Floats, normal: Floats | None, memory: Memory = None) -> Rendered:
        """Return the friction under a load (...) in N, along a surface with a normal or in every direction."""
        if not isinstance(memory, Bristle):
            still = np.zeros(motion.position.shape[:-1], dtype=np.bool_)
            memory = Bristle(motion.position, np.zeros_like(motion.position), still)
        moved = _tangential(motion.position - memory.position, normal)
        previous_stretch = _tangential(memory.stretch, normal)
        rate = self.damping / motion.step
        trial = self.stiffness * (previous_stretch + moved) + rate * moved
        size = norm(trial)
        limit = np.where(memory.sliding, self.dynamic, self.static) * load
        sliding = size > limit
        # It resists with mu_d from the step in which it begins to slide.
        share = np.where(sliding, self.dynamic * load / np.where(size > 0.0, size, 1.0), 1.0)
        force = share[..., None] * trial
        slid = (force + rate * previous_stretch) / (self.stiffness + rate)
        stretch = np.where(sliding[..., None], slid, previous_stretch + moved)
        return Rendered(-force, Bristle(motion.position, stretch, sliding))


def _tangential(vector: Floats, normal: Floats | None) -> Floats:
    return vector if normal is None else vector - dot(vector, normal)[..., None] * normal


@parameters.checked_dataclass(EffectError)
class Ripples:
    """Even ripples across a surface under a load: the slope of their sides.

    With x along the direction and F_n the load, ``-F_n (2 pi A/l) cos(2 pi x/l)`` for ripples of height A and
    period l. They fade where they pass faster than the loop can render: from 1 at ``|v|/l = rate/10`` to 0 at
    twice that speed, where rate is the number of steps per second. A valley holds a hand like a spring of ``F_n (2
    pi/l)² A``, 740 N/m per newton by default; above ``stiffness``, the height is reduced. Clean textures need 5 to
    10 kHz (Choi and Tan 2004, "Perceived instability of virtual haptic texture").
    """

    direction: parameters.Direction = (1.0, 0.0, 0.0)
    """Direction across the ripples."""
    period: parameters.Length = 0.004
    """Length l of one ripple, in m."""
    height: parameters.NonNegativeLength = 0.0003
    """Height A of the ripples, in m."""
    stiffness: parameters.Stiffness = 10_000.0
    """Largest stiffness of a valley, in N/m; the default is reached under a load of 13 N."""

    def across(self, normal: Floats) -> Floats:
        """Return the unit vector across them, along a surface with this normal (d,); zero if there is none."""
        direction = normalized(np.asarray(self.direction, dtype=np.float64))
        across = direction - (direction @ normal) * normal
        return normalized(across) if np.linalg.norm(across) > 1e-6 else np.zeros_like(across)

    def push(self, x: Floats, speed: Floats, load: Floats, step: float) -> Floats:
        """Return their push at x (...), at a speed (...) in m/s under a load (...) in N."""
        wave = 2.0 * math.pi / self.period
        pressed = np.minimum(load * self.height, self.stiffness / wave**2)
        return -pressed * self.fade(speed, step) * wave * np.cos(wave * x)

    def fade(self, speed: Floats, step: float) -> Floats:
        """Return the share of their height that a loop with a step in s renders at a speed (...) in m/s."""
        return np.clip(2.0 - 10.0 * np.abs(speed) / self.period * step, 0.0, 1.0)


@parameters.checked_dataclass(EffectError)
class Texture:
    """Rough surface: a wall on a module; friction and ripples on the host.

    Continuous in the position for a hand at rest. Not passive: the load may be larger on the way down a ripple
    than on the way up, and the ripple then gives up to ``2 A (F_n down - F_n up)``, 0.6 mJ per newton.
    """

    wall: Wall = field(default_factory=Wall)
    """Wall that presses."""
    friction: Friction = field(default_factory=Friction)
    """Friction along it."""
    ripples: Ripples = Ripples()
    """Ripples across it."""

    def __post_init__(self) -> None:
        direction, normal = self.ripples.direction, self.wall.plane.normal
        both = f"ripples.direction is {direction}, wall.plane.normal {normal}"
        if len(direction) != len(normal):
            raise EffectError(f"{both}; give both as many components as the rig has axes")
        if not np.linalg.norm(self._across) > 0.5:
            raise EffectError(f"{both}; give a direction along the surface")

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the push, friction and ripples; the memory is the friction's."""
        host = self.host_side(motion, memory)
        return host._replace(force=host.force + self.wall.render(motion).force)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance:
        """Return the wall."""
        return self.wall.module_side(motion)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return friction and ripples."""
        load = self.wall.push(motion)
        rub = self.friction.rub(motion, load, self.wall.plane.n, memory)
        x = dot(motion.position - np.asarray(self.wall.plane.point), self._across)
        push = self.ripples.push(x, dot(motion.velocity, self._across), load, motion.step)
        return rub._replace(force=rub.force + push[..., None] * self._across)

    def frequency_at(self, motion: Motion) -> float:
        """Return the frequency at which ripples pass the hand, in Hz."""
        return abs(float(motion.velocity @ self._across)) / self.ripples.period

    @cached_property
    def _across(self) -> Floats:
        return self.ripples.across(self.wall.plane.n)
