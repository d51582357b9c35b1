"""Effects of things in the hand: a weight, a shot, a bow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import parameters
from tensionlab.haptics.effects.effect import AxisImpedance, Memory, Motion, Rendered, norm, normalized, smoothstep
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief


class WeightMotion(NamedTuple):
    """Memory of a weight: the velocity of the step before, and the low-passed acceleration; (..., d) each."""

    velocity: Floats
    acceleration: Floats


@dataclass(frozen=True)
class Weight(parameters.Parameters):
    """Mass in the hand: gravity, and its inertia, ``F = m (g - a)``.

    a is the change of the velocity, low-passed (first order), each component clipped; then the whole rises from 0
    to 1 after the grasp. Continuous for a hand whose velocity is. Gravity is passive; the inertia is not, since it
    comes late.

    Parameters
    ----------
    mass : float
        Mass m, in kg. 0.5 is a default of this project; 6 N, the most of one module right below, is 0.61 kg.
    gravity : tuple of d floats
        Gravity g, in m/s². Left out of a message or a file, it points down, by the rig's ``up``.
    cutoff : float
        Cutoff of the low-pass on the acceleration, in Hz; 10 is a default of this project.
    limit : float
        Limit of each component of the acceleration, in m/s²; 5 is a default of this project.
    grasped : float
        Time at which it was taken, in s, on the motion's clock, or -inf for long ago.
    ramp : float
        Time in which its force then rises, in s; 0.1 is a default of this project.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.haptics.effects import Motion, Weight
    >>> Weight(mass=0.5).render(Motion(np.zeros(3), np.zeros(3))).force.round(3)
    array([ 0.   ,  0.   , -4.905])
    """

    mass: parameters.Mass = 0.5
    gravity: parameters.Gravity = (0.0, 0.0, -GRAVITY_M_S2)
    cutoff: parameters.Frequency = 10.0
    limit: parameters.Acceleration = 5.0
    grasped: parameters.TimeOrEver = -math.inf
    ramp: parameters.Duration = 0.1

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the pull down, and against the acceleration."""
        if not isinstance(memory, WeightMotion):
            memory = WeightMotion(motion.velocity, np.zeros_like(motion.velocity))
        now = (motion.velocity - memory.velocity) / motion.step
        share = -math.expm1(-2.0 * math.pi * self.cutoff * motion.step)
        acceleration = memory.acceleration + share * (now - memory.acceleration)
        force = self.mass * (np.asarray(self.gravity) - np.clip(acceleration, -self.limit, self.limit))
        held = np.clip((np.asarray(motion.time) - self.grasped) / self.ramp, 0.0, 1.0)
        return Rendered(held[..., None] * force, WeightMotion(motion.velocity, acceleration))


@dataclass(frozen=True)
class Recoil(parameters.Parameters):
    """Shot: a kick that rises at once and fades.

    After each shot ``F = F_p t/t_r`` up to t_r, then ``F_p exp(-(t - t_r)/tau)``, along the direction; what is
    left of earlier shots adds to it. Its impulse is ``F_p (t_r/2 + tau)``, 0.34 N s: about a tenth of a real 9 mm
    pistol. It rises faster than the common limit of 200 N/s, and bypasses it for five tau. But a module
    has a limit of its own: at the 60 N/s with which it comes, 2.8 N and 0.23 N s are left of a shot; at 300 N/s,
    its most, 4.6 N and 0.31 N s. Continuous. Not passive.

    Parameters
    ----------
    shots : tuple of float
        Times of the shots, in s, on the motion's clock, in order; the last few will do.
    direction : tuple of d floats
        Direction in which the hand is kicked; its length does not matter.
    peak : float
        Largest force F_p of a shot, in N; 5.5 is a default of this project.
    rise : float
        Time t_r in which the force rises, in s; 5 ms is a default of this project.
    fade : float
        Time constant tau with which it fades, in s; 60 ms is a default of this project.
    rate : float
        Largest rate of shots, in 1/s; 10 is a default of this project.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.haptics.effects import Motion, Recoil
    >>> Recoil(shots=(1.0,)).render(Motion(np.zeros(3), np.zeros(3), time=1.005)).force.round(3) + 0.0
    array([ 0. , -5.5,  0. ])
    """

    shots: parameters.Times = ()
    direction: parameters.Direction = (0.0, -1.0, 0.0)
    peak: parameters.Force = 5.5
    rise: parameters.Duration = 0.005
    fade: parameters.Duration = 0.060
    rate: parameters.Rate = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (np.diff(self.shots) < (1.0 - 1e-9) / self.rate).any():
            raise EffectError(
                f"Recoil: shots are {brief(self.shots)}; give times in order, {1.0 / self.rate:g} s apart or more"
            )

    @property
    def impulse(self) -> float:
        """Impulse of a shot, in N s."""
        return self.peak * (self.rise / 2 + self.fade)

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


@dataclass(frozen=True)
class Bow(parameters.Parameters):
    """Bow, for the hand that draws it. The motion is that hand's, seen from the bow's.

    Drawn by ``x = max(0, |p| - brace)``, it pulls towards the bow's hand with ``F = min(F_max, F_0 + k x)``; a
    compound bow lets off, ``F (1 - let_off s)``, where s goes as a smoothstep from 0 at ``valley x_d`` to 1 at
    x_d. Its energy is the integral of F dx. Once loosed, F goes linearly to the slack tension within ``loose``,
    and the string hums: with ``e = exp(-t/fade)``, at least ``slack + A e`` is pulled, and ``A e sin(2 pi f t)``
    on top, so that the cable never goes slack. That pretension, 1.5 N at first, fades with the hum: held at 1.5 N,
    it would never come down to the slack tension. The force bypasses the slew limit from the loose on, for five
    fades; a module falls no faster than its own limit, 5.5 N in 92 ms at 60 N/s, in 18 ms at 300 N/s. Until the
    loose it is continuous, and passive. At the bow's hand itself it pulls nowhere. On the other hand acts the
    opposite.

    Parameters
    ----------
    brace : float
        Distance of the string undrawn, in m; 0.20 is a default of this project.
    initial : float
        Pull F_0 at which the draw begins, in N; 1 is a default of this project.
    stiffness : float
        Stiffness k, in N/m; 8.3 is a default of this project.
    most : float
        Largest pull F_max, in N; 6 is a default of this project.
    draw_length : float
        Draw x_d, in m, where it is fully drawn, and a brake may lock; 0.60 is a default of this project.
    let_off : float
        Share of the pull that a compound bow takes back, 0.6 to 0.8; 0: none, the default.
    valley : float
        Share of the draw length at which the let-off begins; 0.75 is a default of this project.
    loosed : float
        Time at which the string was released, in s, on the motion's clock, or inf for not yet.
    slack : float
        Tension after the release, in N; 0.5, the modules' least, is a default of this project.
    loose : float
        Time in which the pull then falls, in s; 10 ms is a default of this project.
    hum : float
        Amplitude A of the string's hum, in N; 1 is a default of this project.
    frequency : float
        Frequency f of the hum, in Hz; 60 is a default of this project.
    fade : float
        Time constant with which the hum fades, in s; 50 ms is a default of this project.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.haptics.effects import Bow, Motion
    >>> Bow().render(Motion(np.array([0.5, 0.0, 0.0]), np.zeros(3))).force.round(3) + 0.0
    array([-3.49,  0.  ,  0.  ])
    """

    brace: parameters.LengthOrNone = 0.20
    initial: parameters.Force = 1.0
    stiffness: parameters.Stiffness = 8.3
    most: parameters.Force = 6.0
    draw_length: parameters.Length = 0.60
    let_off: parameters.Share = 0.0
    valley: parameters.Share = 0.75
    loosed: parameters.TimeOrNever = math.inf
    slack: parameters.Force = 0.5
    loose: parameters.Duration = 0.010
    hum: parameters.Force = 1.0
    frequency: parameters.ModuleFrequency = 60.0
    fade: parameters.Duration = 0.050

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.valley == 1.0:
            raise EffectError("Bow: valley is 1; give a share below 1, so that it lets off before it is drawn")

    def draw(self, motion: Motion) -> Floats:
        """Return how far it is drawn, in m."""
        return np.maximum(norm(motion.position) - self.brace, 0.0)

    def pull(self, draw: Floats) -> Floats:
        """Return its pull when drawn that far, in N."""
        start = self.valley * self.draw_length
        off = smoothstep((draw - start) / (self.draw_length - start))
        pull: Floats = np.minimum(self.initial + self.stiffness * draw, self.most) * (1.0 - self.let_off * off)
        return pull

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the pull of the string's hand towards the bow's."""
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
        """Return the spring, up to the module's own limit; once loosed, the hum. With let-off it is host-side."""
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
        """Return no force, but whether it may jump."""
        return Rendered(np.zeros_like(motion.position), bypass_slew=self.render(motion).bypass_slew)
