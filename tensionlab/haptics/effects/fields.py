"""Which shape is it? Signed distance fields: how far is a point from the surface, and which way is out?

A field is any callable that takes positions (..., d) and returns distances (...), in m and negative inside, and
the unit vectors (..., d) of their steepest rise. Beyond the surface a distance may be too small, never too large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import EffectError
from tensionlab.haptics.effects.contact import ORIGIN, Plane
from tensionlab.haptics.effects.effect import along, length_of
from tensionlab.haptics.effects.parameters import Edges, Length, Point, Range, require_parameters

Field = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True)
class HalfSpace:
    """All that is below a plane."""

    plane: Plane = field(default_factory=Plane)

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """How far, and which way is out?"""
        return self.plane.height(position), np.broadcast_to(self.plane.n, position.shape)


@dataclass(frozen=True)
class Sphere:
    """A ball; in the plane, a disc. At its very centre, out is the last axis.

    Parameters
    ----------
    centre : tuple of d floats
        In m.
    radius : float
        In m.
    """

    centre: Point = ORIGIN
    radius: Length = 0.10

    def __post_init__(self) -> None:
        require_parameters(self)

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """How far, and which way is out?"""
        arm = position - np.asarray(self.centre)
        size = length_of(arm)
        last = np.eye(position.shape[-1])[-1]
        return size - self.radius, np.where(size[..., None] > 0.0, along(arm), last)


@dataclass(frozen=True)
class Box:
    """A box along the axes. Inside, out is through the nearest face; of equally near ones, the first axis's.

    Parameters
    ----------
    centre : tuple of d floats
        In m.
    size : tuple of d floats
        Its edges, in m.
    """

    centre: Point = ORIGIN
    size: Edges = (0.2, 0.2, 0.2)

    def __post_init__(self) -> None:
        require_parameters(self)
        if len(self.centre) != len(self.size):
            raise EffectError(f"Box: size is {self.size}; give {len(self.centre)} edges, as its centre has axes")

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """How far, and which way is out?"""
        arm = position - np.asarray(self.centre)
        beyond = np.abs(arm) - np.asarray(self.size) / 2
        side = np.where(arm >= 0.0, 1.0, -1.0)
        outside = np.maximum(beyond, 0.0)
        nearest = np.argmax(beyond, axis=-1)
        inside = beyond.max(axis=-1) <= 0.0
        face = side * np.eye(position.shape[-1])[nearest]
        distance = np.where(inside, beyond.max(axis=-1), length_of(outside))
        return distance, np.where(inside[..., None], face, side * along(outside))


@dataclass(frozen=True)
class Distance:
    """A field from a function that tells the distance alone; which way is out comes from central differences.

    Parameters
    ----------
    of : callable
        Takes positions (..., d), returns distances (...), in m.
    step : float
        Of the differences, in m.
    """

    of: Callable[[Floats], Floats]
    step: Annotated[float, Range("m", 1e-9, 1.0)] = 1e-5

    def __post_init__(self) -> None:
        require_parameters(self)

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """How far, and which way is out?"""
        shifts = self.step * np.eye(position.shape[-1])
        ahead, behind = (self.of(position[..., None, :] + sign * shifts) for sign in (1.0, -1.0))
        return self.of(position), along(ahead - behind)
