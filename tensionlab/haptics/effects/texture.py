"""What does a rough surface feel like?"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import EffectError
from tensionlab.haptics.effects.contact import Wall
from tensionlab.haptics.effects.effect import Memory, Motion, Rendered, along, dot
from tensionlab.haptics.effects.friction import Friction
from tensionlab.haptics.effects.on_module import AxisImpedance
from tensionlab.haptics.effects.parameters import Direction, Length, LengthOrNone, Stiffness, require_parameters


@dataclass(frozen=True)
class Ripples:
    """What do even ripples across a surface feel like, under a load? The slope of their sides.

    With x the way along the direction and F_n the load, ``-F_n (2 pi A/l) cos(2 pi x/l)`` for ripples of height A
    and period l. It fades where they pass by faster than the loop can render: by a share from 1 at ``|v|/l =
    rate/10`` to 0 at twice that, where the rate is one a step. In their valleys they hold a hand like a spring of
    ``F_n (2 pi/l)² A``, 740 N/m for each newton with these defaults: where that is more than ``stiffness``, they
    are so much lower. Clean textures want 5 to 10 kHz (Choi and Tan 2004, "Perceived instability of virtual haptic
    texture").

    Parameters
    ----------
    direction : tuple of d floats
        Across the ripples; what of it is along the surface's normal is left out.
    period : float
        l in m; 4 mm is a default of this project.
    height : float
        A in m; 0.3 mm is a default of this project.
    stiffness : float
        In N/m. 10 kN/m, more than the defaults have up to 13 N, is a default of this project.
    """

    direction: Direction = (1.0, 0.0, 0.0)
    period: Length = 0.004
    height: LengthOrNone = 0.0003
    stiffness: Stiffness = 10_000.0

    def __post_init__(self) -> None:
        require_parameters(self)

    def across(self, normal: Floats) -> Floats:
        """Unit vector across them, along a surface with this normal (d,); zero where there is none."""
        direction = along(np.asarray(self.direction, dtype=np.float64))
        across = direction - (direction @ normal) * normal
        return along(across) if np.linalg.norm(across) > 1e-6 else np.zeros_like(across)

    def push(self, x: Floats, speed: Floats, load: Floats, step: float) -> Floats:
        """How hard do they push along x (...), passing at a speed (...) in m/s, under a load (...) in N?"""
        wave = 2.0 * math.pi / self.period
        pressed = np.minimum(load * self.height, self.stiffness / wave**2)
        fade = np.clip(2.0 - 10.0 * np.abs(speed) / self.period * step, 0.0, 1.0)
        return -pressed * fade * wave * np.cos(wave * x)


@dataclass(frozen=True)
class Texture:
    """What does a rough surface feel like? A wall, friction on it, and ripples across.

    Continuous in the position for a hand at rest. Not passive: the load may be larger on the way down a ripple
    than on the way up. A ripple gives at most ``2 A (F_n down - F_n up)`` that way, 0.6 mJ a newton. That the wall
    runs on a module, and the rest on the host, is a choice of this project.

    Parameters
    ----------
    wall : Wall
        Runs on a module.
    friction : Friction
        Its load is the wall's push.
    ripples : Ripples
        Theirs is, too.
    """

    wall: Wall = field(default_factory=Wall)
    friction: Friction = field(default_factory=Friction)
    ripples: Ripples = Ripples()

    def __post_init__(self) -> None:
        if len(self.ripples.direction) != len(self.wall.plane.normal):
            raise EffectError(
                f"Texture: ripples.direction is {self.ripples.direction}, wall.plane.normal "
                f"{self.wall.plane.normal}; give both as many components as the rig has axes"
            )
        if not np.linalg.norm(self._across) > 0.5:
            raise EffectError(
                f"Texture: direction {self.ripples.direction} is along the wall's normal "
                f"{self.wall.plane.normal}; give one along the surface"
            )

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Push, rub and ripple; the memory is the friction's."""
        done = self.on_host(motion, memory)
        return done._replace(force=done.force + self.wall.render(motion).force)

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """The wall."""
        return self.wall.on_module(motion)

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Friction and ripples."""
        load = self.wall.push(motion)
        rub = self.friction.rub(motion, load, self.wall.plane.n, memory)
        x = dot(motion.position - np.asarray(self.wall.plane.point), self._across)
        push = self.ripples.push(x, dot(motion.velocity, self._across), load, motion.step)
        return rub._replace(force=rub.force + push[..., None] * self._across)

    @cached_property
    def _across(self) -> Floats:
        return self.ripples.across(self.wall.plane.n)
