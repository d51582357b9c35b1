"""Solids of any shape: signed distance fields, and a spring to a proxy that stays on the surface.

A field is any callable that takes positions (..., d) and returns distances (...), in m and negative inside, and
the unit vectors (..., d) of their steepest rise. Beyond the surface a distance may be too small, never too large.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, WithJsonSchema

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import parameters
from tensionlab.haptics.effects.contact import ORIGIN
from tensionlab.haptics.effects.effect import AxisImpedance, Memory, Motion, Rendered, dot, norm, normalized
from tensionlab.support.arrays import Floats
from tensionlab.support.validation import take_kind, validate

Field = Callable[[Floats], tuple[Floats, Floats]]
MAX_PROXY_STEPS = 10  # projections per step of the proxy; a slow hand needs two or three
ON_SURFACE_M = 1e-6  # within this distance of the surface a proxy is on it; a step this short is the last
NEAR_SURFACE_M = 1e-3  # within this distance of the surface a proxy goes straight on, but not inside


@parameters.checked_dataclass(EffectError)
class Sphere:
    """Ball; in the plane, a disc. At the centre, the last axis points out."""

    centre: parameters.Point = ORIGIN
    """Centre, in m."""
    radius: parameters.Length = 0.10
    """Radius, in m."""

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """Return distances and directions out."""
        arm = position - np.asarray(self.centre)
        size = norm(arm)
        last = np.eye(position.shape[-1])[-1]
        return size - self.radius, np.where(size[..., None] > 0.0, normalized(arm), last)


@parameters.checked_dataclass(EffectError)
class Box:
    """Box along the axes. From inside, the way out is through the nearest face (ties: the first axis)."""

    centre: parameters.Point = ORIGIN
    """Centre, in m."""
    size: parameters.Edges = (0.2, 0.2, 0.2)
    """Lengths of its edges, in m."""

    def __post_init__(self) -> None:
        if len(self.centre) != len(self.size):
            raise EffectError(f"size is {self.size}; give {len(self.centre)} edges, as its centre has axes")

    def __call__(self, position: Floats) -> tuple[Floats, Floats]:
        """Return distances and directions out."""
        arm = position - np.asarray(self.centre)
        beyond = np.abs(arm) - np.asarray(self.size) / 2
        side = np.where(arm >= 0.0, 1.0, -1.0)
        outside = np.maximum(beyond, 0.0)
        nearest = np.argmax(beyond, axis=-1)
        inside = beyond.max(axis=-1) <= 0.0
        face = side * np.eye(position.shape[-1])[nearest]
        distance = np.where(inside, beyond.max(axis=-1), norm(outside))
        return distance, np.where(inside[..., None], face, side * normalized(outside))


# Solids by the names in files and messages; a sphere if they name none.
SOLIDS: dict[str, type[Any]] = {"sphere": Sphere, "box": Box}


def _parse_solid(value: object) -> object:
    """Return the solid that a table describes; a callable as it is."""
    if callable(value):
        return value
    kind, table = take_kind({"kind": "sphere", **value} if isinstance(value, Mapping) else value, SOLIDS)
    return validate(kind, table, EffectError)


@parameters.checked_dataclass(EffectError)
class VirtualCoupling:
    """Spring and damper between the hand and a proxy: ``F = K_c (proxy - p) - B_c v``.

    The hand meets K_c and B_c at most, so they alone decide about stability (Colgate, Stanley and Brown 1995,
    "Issues in the haptic display of tool use").
    """

    stiffness: parameters.Stiffness = 400.0
    """Stiffness K_c, in N/m."""
    damping: parameters.Damping = 0.0
    """Damping B_c, in N s/m."""

    def force(self, motion: Motion, proxy: Floats) -> Floats:
        """Return the force (..., d) on the hand, in N."""
        return self.stiffness * (proxy - motion.position) - self.damping * motion.velocity


class Proxy(NamedTuple):
    """Memory of a shape: its proxy's position (..., d), contact (...) and outward normal (..., d)."""

    position: Floats
    touching: NDArray[np.bool_]
    normal: Floats


@parameters.checked_dataclass(EffectError)
class Shape:
    """Solid of any shape: a spring to a proxy that follows the hand but stays outside.

    ``F = K (proxy - p) - B v`` while the proxy touches, else 0. The proxy is a god-object (Zilles and Salisbury
    1995, "A constraint-based god-object method for haptic display"): it moves towards the hand, each time at most
    by its distance from the surface, and slides along the surface; a hand pushed through a thin plate is drawn
    back to the side it came from. It starts at the point of the surface to which the field leads. Continuous in
    the position of a hand at rest, except where the proxy slides off an edge. Passive: by itself the proxy only
    moves nearer to the hand.
    """

    field: Annotated[Field, BeforeValidator(_parse_solid), WithJsonSchema({})] = Sphere()
    """Signed distance field of the solid."""
    coupling: VirtualCoupling = VirtualCoupling()
    """Spring and damper, K and B."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the force towards the proxy, which is the memory."""
        proxy = self.follow(motion.position, memory)
        force = np.where(proxy.touching[..., None], self.coupling.force(motion, proxy.position), 0.0)
        return Rendered(force, proxy)

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance:
        """Return a wall at the proxy; where it does not touch, at the nearest point of the surface."""
        proxy = self.follow(motion.position, memory)
        if proxy.touching:
            depth = float(dot(proxy.position - motion.position, proxy.normal))
        else:
            depth = -float(self.field(motion.position)[0])
        return AxisImpedance(proxy.normal, depth, self.coupling.stiffness, self.coupling.damping)

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return no force, with the proxy moved on."""
        return Rendered(np.zeros_like(motion.position), self.follow(motion.position, memory))

    def follow(self, position: Floats, before: Memory = None) -> Proxy:
        """Return the proxy of a hand at a position (..., d) in m; a new one starts there, or outside of it."""
        proxy = before.position if isinstance(before, Proxy) else self._outside(position)
        for _ in range(MAX_PROXY_STEPS):
            distance, normal = self.field(proxy)
            way = position - proxy
            inward = np.minimum(dot(way, normal) + distance, 0.0)
            # At the surface: straight on, but not into it. Above: by the distance that is surely free, which close
            # to the surface would be too short to keep up with a hand that skims it.
            free = way * np.minimum(1.0, distance / np.maximum(norm(way), ON_SURFACE_M))[..., None]
            step = np.where((distance <= NEAR_SURFACE_M)[..., None], way - inward[..., None] * normal, free)
            ahead = self._outside(proxy + step)
            # Only nearer, by more than rounding: in a corner it would oscillate.
            nearer = norm(position - ahead) < norm(way) - ON_SURFACE_M**2
            proxy = np.where(nearer[..., None], ahead, proxy)
            if not (nearer & (norm(step) > ON_SURFACE_M)).any():
                break
        distance, normal = self.field(proxy)
        touching = (distance <= 2 * ON_SURFACE_M) & (dot(position - proxy, normal) < 0.0)
        return Proxy(proxy, touching, normal)

    def _outside(self, position: Floats) -> Floats:
        for _ in range(3):
            distance, normal = self.field(position)
            if (distance >= 0.0).all():
                break
            position = position - np.minimum(distance, 0.0)[..., None] * normalized(normal)
        return position
