"""Effects of the space around the hand: viscous damping, springs, water, vibrations."""

from __future__ import annotations

import math
from dataclasses import field
from functools import cached_property

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import parameters
from tensionlab.haptics.effects.contact import ORIGIN, Plane
from tensionlab.haptics.effects.effect import AxisImpedance, Memory, Motion, Rendered, norm, normalized, smoothstep
from tensionlab.support.arrays import Floats


@parameters.checked_dataclass(EffectError)
class Viscous:
    """Viscous damping: ``F = -b v``. Continuous; passive."""

    damping: parameters.Damping = 2.0
    """Damping b, in N s/m."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the drag."""
        return Rendered(-self.damping * motion.velocity)


@parameters.checked_dataclass(EffectError)
class Spring:
    """Spring to a point: ``F = K (centre - p) - B v``. Continuous; passive."""

    centre: parameters.Point = ORIGIN
    """Point to which it pulls, in m."""
    stiffness: parameters.Stiffness = 30.0
    """Stiffness K, in N/m; the default is stable over a link of 30 ms."""
    damping: parameters.Damping = 0.0
    """Damping B, in N s/m."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the pull to the centre."""
        stretch = np.asarray(self.centre) - motion.position
        return Rendered(self.stiffness * stretch - self.damping * motion.velocity)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Return the spring and damper towards the centre; None at the centre, where there is no direction."""
        stretch = np.asarray(self.centre) - motion.position
        size = float(norm(stretch))
        if size == 0.0:
            return None
        return AxisImpedance(stretch / size, size, self.stiffness, self.damping)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the damping across."""
        axis = normalized(np.asarray(self.centre) - motion.position)
        across = motion.velocity - (motion.velocity @ axis) * axis
        return Rendered(-self.damping * across)


@parameters.checked_dataclass(EffectError)
class Water:
    """Water: linear and quadratic drag, and a lift.

    ``F = s (-b v - c |v| v + F_b up)``, where s rises from 0 at the surface to 1 at a depth of ``mixing``, as a
    smoothstep. Pushed by F_0, the hand reaches the speed ``(sqrt(b² + 4 c F_0) - b) / (2 c)``. Continuous.
    Passive: the lift depends on the depth only.
    """

    surface: Plane = field(default_factory=Plane)
    """Surface of the water."""
    linear: parameters.Damping = 2.0
    """Linear drag b, in N s/m."""
    quadratic: parameters.QuadraticDamping = 3.0
    """Quadratic drag c, in N s²/m²."""
    lift: parameters.Force = 1.0
    """Lift F_b, in N."""
    mixing: parameters.Length = 0.02
    """Depth at which drag and lift are complete, in m."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return drag and lift."""
        share = smoothstep(-self.surface.height(motion.position) / self.mixing)
        drag = self.linear + self.quadratic * norm(motion.velocity)
        force = self.lift * self.surface.n - drag[..., None] * motion.velocity
        return Rendered(share[..., None] * force)


@parameters.checked_dataclass(EffectError)
class Vibration:
    """Vibration: ``F = A sin(2 pi f t) axis``. Not passive: it does work, like a motor.

    It runs on a module, whose cable pulls with A above its minimum tension, so that it never goes slack. A host
    would need more than ten steps per period. A module's slew-rate limit, 60 N/s by default and up to 300, bounds
    what is rendered: ``A = slew/(2 pi f)``, 0.24 N at 40 Hz.
    """

    axis: parameters.Direction = (0.0, 0.0, 1.0)
    """Direction in which it shakes."""
    amplitude: parameters.Force = 1.0
    """Amplitude A, in N."""
    frequency: parameters.ModuleFrequency = 40.0
    """Frequency f, in Hz."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the push or pull at the motion's time."""
        phase = 2.0 * math.pi * self.frequency * np.asarray(motion.time)
        force = (self.amplitude * np.sin(phase))[..., None] * self._axis
        return Rendered(np.broadcast_to(force, np.broadcast_shapes(force.shape, motion.position.shape)))

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance:
        """Return the whole vibration."""
        return AxisImpedance(self._axis, amplitude=self.amplitude, frequency=self.frequency)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return no force."""
        return Rendered(np.zeros_like(motion.position))

    @cached_property
    def _axis(self) -> Floats:
        return normalized(np.asarray(self.axis, dtype=np.float64))
