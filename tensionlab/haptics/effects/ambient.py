"""Effects without a surface: damping, springs, water, vibrations; a weight, a shot and a bow in the hand."""

from __future__ import annotations

import math
from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import parameters
from tensionlab.haptics.effects.contact import ORIGIN, Plane
from tensionlab.haptics.effects.effect import AxisImpedance, Memory, Motion, Rendered, norm, normalized, smoothstep
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief


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

    It runs on the module whose cable is within 20 degrees of the axis, or on all free ones together, in phase or
    half a turn apart; their cables pull with A above the minimum tension, so that they never go slack. A host
    would need more than ten steps per period. A spool resonates on its cable: the motor's amplitude is A over the
    module's ``vibration_gain`` at f. Its slew-rate limit, 60 N/s by default and up to 300, bounds that amplitude:
    ``slew/(2 pi f)``, 0.24 N at 40 Hz.
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


class WeightMotion(NamedTuple):
    """Memory of a weight: previous velocity and low-passed acceleration, (..., d) each."""

    velocity: Floats
    acceleration: Floats


@parameters.checked_dataclass(EffectError)
class Weight:
    """Mass in the hand: gravity and inertia, ``F = m (g - a)``.

    a is the change of the velocity, low-passed (first order) and clipped by component; the force ramps up after
    the grasp. Continuous if the hand's velocity is. Gravity is passive; the inertia, being late, is not.
    """

    mass: parameters.Mass = 0.5
    """Mass m, in kg; 0.61 kg weigh 6 N, the limit of one module right below."""
    gravity: parameters.Gravity = (0.0, 0.0, -GRAVITY_M_S2)
    """Gravity g, in m/s²."""
    cutoff: parameters.Frequency = 10.0
    """Cutoff of the low-pass on the acceleration, in Hz."""
    limit: parameters.Acceleration = 5.0
    """Limit of each component of the acceleration, in m/s²."""
    grasped: parameters.PastTime = -math.inf
    """Time of the grasp, in s, on the clock of the run; long ago if left out."""
    ramp: parameters.Duration = 0.1
    """Time in which the force then rises, in s."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return gravity and inertia."""
        if not isinstance(memory, WeightMotion):
            memory = WeightMotion(motion.velocity, np.zeros_like(motion.velocity))
        now = (motion.velocity - memory.velocity) / motion.step
        share = -math.expm1(-2.0 * math.pi * self.cutoff * motion.step)
        acceleration = memory.acceleration + share * (now - memory.acceleration)
        force = self.mass * (np.asarray(self.gravity) - np.clip(acceleration, -self.limit, self.limit))
        held = np.clip((np.asarray(motion.time) - self.grasped) / self.ramp, 0.0, 1.0)
        return Rendered(held[..., None] * force, WeightMotion(motion.velocity, acceleration))


@parameters.checked_dataclass(EffectError)
class Recoil:
    """Shot: a kick that rises at once and fades.

    After each shot ``F = F_p t/t_r`` up to t_r, then ``F_p exp(-(t - t_r)/tau)``, along the direction; shots add
    up. The impulse is ``F_p (t_r/2 + tau)``, 0.34 N s: about a tenth of a real 9 mm pistol. The force bypasses the
    host's slew limit of 200 N/s for five tau. A module's own limit remains: at its default of 60 N/s, 2.8 N and
    0.23 N s are left of a shot; at its largest, 300 N/s, 4.6 N and 0.31 N s. Continuous. Not passive.
    """

    shots: parameters.Times = ()
    """Times of the shots, in s, on the clock of the run, in order."""
    direction: parameters.Direction = (0.0, -1.0, 0.0)
    """Direction in which the hand is kicked."""
    peak: parameters.Force = 5.5
    """Largest force F_p of a shot, in N."""
    rise: parameters.Duration = 0.005
    """Time t_r in which the force rises, in s."""
    fade: parameters.Duration = 0.060
    """Time constant tau with which it fades, in s."""
    rate: parameters.Rate = 10.0
    """Largest rate of shots, in 1/s."""

    def __post_init__(self) -> None:
        if (np.diff(self.shots) < (1.0 - 1e-9) / self.rate).any():
            apart = f"{1.0 / self.rate:g} s apart or more"
            raise EffectError(f"shots are {brief(self.shots)}; give times in order, {apart}")

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the kick."""
        since = np.asarray(motion.time)[..., None] - np.asarray(self.shots)
        late = np.maximum(since - self.rise, 0.0)
        kick = self.peak * (np.clip(since / self.rise, 0.0, 1.0) * np.exp(-late / self.fade)).sum(axis=-1)
        force = kick[..., None] * self._direction
        force = np.broadcast_to(force, np.broadcast_shapes(force.shape, motion.position.shape))
        return Rendered(force, bypass_slew=((since >= 0.0) & (late <= 5.0 * self.fade)).any(axis=-1))

    @cached_property
    def _direction(self) -> Floats:
        return normalized(np.asarray(self.direction, dtype=np.float64))


@parameters.checked_dataclass(EffectError)
class Bow:
    """Bow, for the hand that draws it. The motion is that hand's, relative to the bow's.

    Drawn by ``x = max(0, |p| - brace)``, it pulls towards the bow's hand with ``F = min(F_max, F_0 + k x)``; a
    compound bow lets off, ``F (1 - let_off s)``, where s is a smoothstep from 0 at ``valley x_d`` to 1 at x_d.
    Its energy is the integral of F dx. After the release F falls linearly to the slack tension within ``loose``,
    and the string hums: with ``e = exp(-t/fade)``, the pull is at least ``slack + A e``, plus
    ``A e sin(2 pi f t)``, so that the cable never goes slack. From the release on, for five fades, the force
    bypasses the slew limit; a module's own limit remains, 5.5 N in 92 ms at 60 N/s, in 18 ms at 300 N/s. Until the
    release it is continuous and passive. At the bow's hand the force is zero. The opposite force acts on the other
    hand.
    """

    brace: parameters.NonNegativeLength = 0.20
    """Distance of the undrawn string, in m."""
    initial: parameters.Force = 1.0
    """Pull F_0 at the begin of the draw, in N."""
    stiffness: parameters.Stiffness = 8.3
    """Stiffness k, in N/m."""
    most: parameters.Force = 6.0
    """Largest pull F_max, in N."""
    draw_length: parameters.Length = 0.60
    """Full draw x_d, in m, at which a brake may lock."""
    let_off: parameters.Share = 0.0
    """Let-off of a compound bow, as a share of the pull, 0.6 to 0.8."""
    valley: parameters.Share = 0.75
    """Share of the draw length at which the let-off begins."""
    loosed: parameters.FutureTime = math.inf
    """Time of the release, in s, on the clock of the run; not yet if left out."""
    slack: parameters.Force = 0.5
    """Tension after the release, in N."""
    loose: parameters.Duration = 0.010
    """Time in which the pull then falls, in s."""
    hum: parameters.Force = 1.0
    """Amplitude A of the string's hum, in N."""
    frequency: parameters.ModuleFrequency = 60.0
    """Frequency f of the hum, in Hz."""
    fade: parameters.Duration = 0.050
    """Time constant of the hum's decay, in s."""

    def __post_init__(self) -> None:
        if self.valley == 1.0:
            raise EffectError("valley is 1; give a share below 1, so that it lets off before it is drawn")

    def draw(self, motion: Motion) -> Floats:
        """Return the draw, in m."""
        return np.maximum(norm(motion.position) - self.brace, 0.0)

    def pull(self, draw: Floats) -> Floats:
        """Return the pull at a draw in m, in N."""
        start = self.valley * self.draw_length
        off = smoothstep((draw - start) / (self.draw_length - start))
        pull: Floats = np.minimum(self.initial + self.stiffness * draw, self.most) * (1.0 - self.let_off * off)
        return pull

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the pull towards the bow's hand."""
        since = np.asarray(motion.time) - self.loosed
        gone = np.where(since >= 0.0, 1.0, 0.0)
        late = np.maximum(since, 0.0)
        held = 1.0 - np.clip(late / self.loose, 0.0, 1.0)
        falling = self.slack + (self.pull(self.draw(motion)) - self.slack) * held
        hum = gone * self.hum * np.exp(-late / self.fade)
        pull = np.maximum(falling, gone * (self.slack + hum)) + hum * np.sin(2.0 * math.pi * self.frequency * late)
        bypass = (since >= 0.0) & (since <= 5.0 * self.fade)
        return Rendered(-pull[..., None] * normalized(motion.position), bypass_slew=bypass)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Return the spring, up to the module's own limit, or the hum after the release; None with let-off."""
        since = float(motion.time) - self.loosed
        if not motion.position.any() or (since < 0.0 and self.let_off > 0.0):
            return None
        axis = -normalized(motion.position)
        if since < 0.0:
            drawn = float(norm(motion.position)) - self.brace
            return AxisImpedance(axis, drawn, self.stiffness, feed_forward=self.initial)
        hum = self.hum * math.exp(-since / self.fade)
        return AxisImpedance(axis, feed_forward=self.slack + hum, amplitude=hum, frequency=self.frequency)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return no force, and whether it may jump."""
        return Rendered(np.zeros_like(motion.position), bypass_slew=self.render(motion).bypass_slew)
