"""Space of layouts: surfaces for modules and for attachments, and the places that genes encode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, InstanceOf, PositiveInt
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tensionlab.errors import RigError
from tensionlab.model import kinematics, pose
from tensionlab.model.bodies import Body
from tensionlab.model.layouts import LIMITS
from tensionlab.model.module import WORLD, Module, Platform, TensionLimits, require_name, upward, vector
from tensionlab.model.pose import RestPose
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers, as_floats, readonly_copy
from tensionlab.support.files.reading import brief
from tensionlab.support.formatting import format_range, format_vector
from tensionlab.support.validation import raises

Hardware = Literal["brake", "newton_per_ampere", "spool_radius"]  # keys of a module other than its limits
Tension = Annotated[float, Field(ge=0.0, allow_inf_nan=False, description="in N")]
MAX_ORDER = 12  # of turns into itself
GENE_BORDER = 0.15  # share of an edge's genes that decode to each of its two ends: good places are often there


@dataclass(frozen=True, eq=False)
class Surface:
    """Point, rail, rectangle or box: all ``corner + x @ edges``, with the entries of x from 0 to 1.

    RigError names the surface and the wrong key.

    Attributes
    ----------
    name : str
        Name; its modules have it with a number.
    corner : (d,) read-only array
        Where all edges start, in the axes of ``frame``, in m.
    edges : (k, d) read-only array
        Up to d independent vectors from the corner, in m: none for a point, or a rail, a rectangle, a box.
    frame : str
        "world", or the name of the body frame that it is attached to.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rail = tl.workspace.Surface("rail", corner=[-1.5, 2.4, 0.0], edges=[[3.0, 0.0, 0.0]])
    >>> rail.edges.shape
    (1, 3)
    """

    name: str
    corner: Floats
    edges: Floats = field(default_factory=lambda: np.empty(0))
    frame: str = WORLD

    def __repr__(self) -> str:
        edges = ", ".join(map(format_vector, self.edges))
        return f"<Surface {self.name}: {format_vector(self.corner)} m{f' along {edges} m' if edges else ''}>"

    def __post_init__(self) -> None:
        require_name(self.name, "surface", "name", "give every surface a name")
        here = f'surface "{self.name}"'
        corner = vector(self.corner, here, "corner")
        edges, d = as_floats("edges", self.edges), corner.size
        edges = readonly_copy(edges if edges.size else np.empty((0, d)))
        if d not in (2, 3) or edges.ndim != 2 or edges.shape[1] != d or len(edges) > d:
            raise RigError(f'{here}: key "edges" must list 1 to {d} vectors of {d} coordinates in m, or none')
        if not np.isfinite(edges).all() or (len(edges) and np.linalg.matrix_rank(edges) < len(edges)):
            raise RigError(f'{here}: key "edges" has edges that are zero, parallel or not finite; correct them')
        object.__setattr__(self, "corner", corner)
        object.__setattr__(self, "edges", edges)


def room(size: Sequence[float], centre: Sequence[float] | None = None) -> tuple[Surface, ...]:
    """Return the surfaces of a room: floor, ceiling and four walls; Y is up.

    ``size`` is along X, Y and Z, in m. ``centre``, in m, is the middle of the room; left out, the middle of its
    floor is the origin. RigError if the size is not three positive numbers.

    Examples
    --------
    >>> import tensionlab as tl
    >>> [surface.name for surface in tl.workspace.room([3.0, 2.4, 4.0])]
    ['left wall', 'right wall', 'floor', 'ceiling', 'back wall', 'front wall']
    """
    extent = vector(size, "room", "size")
    if extent.shape != (3,) or (extent <= 0).any():
        raise RigError(f"room: size is {brief(size)}; give three lengths in m, above zero")
    middle = np.array([0.0, extent[1] / 2, 0.0]) if centre is None else vector(centre, "room", "centre")
    low, along = middle - extent / 2, np.diag(extent)
    faces = (("left wall", "right wall"), ("floor", "ceiling"), ("back wall", "front wall"))
    return tuple(
        Surface(name, low + far * along[axis], np.delete(along, axis, axis=0))
        for axis, names in enumerate(faces)
        for far, name in enumerate(names)
    )


class SurfaceGeometry(NamedTuple):
    """Surfaces in the world, then attachments in the axes of the platform."""

    corners: Floats  # (s, d)
    edges: Floats  # (s, d, d)
    fixed: Floats  # ends of the fixed modules' cables, (f, e, d)


class Placement(NamedTuple):
    """Places of the ends of k cables: an anchor and, on a platform, an attachment (e is 1 or 2)."""

    surfaces: Integers  # indices (..., k, e), those of attachments after those of the surfaces for modules
    along: Floats  # shares (..., k, e, d) of the edges from 0 to 1, without meaning where there is no edge


@raises(RigError)
@pydantic_dataclass(frozen=True, eq=False)
class Space:
    """Surfaces for modules, their number and limits. RigError names what is wrong.

    With ``attachments`` the cables hold a platform, and a layout also says where each cable ends on it.

    Attributes
    ----------
    counts : tuple of int
        Numbers of modules to place, in addition to the fixed ones; a layout is searched for each.
    limits : (lower, upper)
        Tension limits of the modules that are placed, in N.
    hardware : mapping of str to float
        Other keys of these modules, as in `Module`: ``brake``, ``newton_per_ampere``, ``spool_radius``.
    fixed : tuple of Module
        Modules with fixed anchors.
    up, platform, required
        As in `Rig`, of the rigs that are found; margins are about the required wrenches.
    rest : tuple of RestPose
        Poses of the body frames while the hand is in the target.
    bodies : tuple of Body
        What the cables must stay clear of while the hand is in the target, such as a standing person.
    attachments : tuple of Surface
        Where cables may end on the platform, in its axes: points, rails, rectangles, boxes; none for a hand, which
        is a point.
    symmetry : tuple of str
        Of anchors about the origin of the world, and of attachments about that of the platform: "x" mirrors x;
        "3-fold" turns by a third of a round about the axis that points up. Cables are placed with their images,
        which need not lie on a surface.

    Examples
    --------
    >>> import tensionlab as tl
    >>> space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=(4,), limits=(0.5, 6.0))
    >>> len(space.surfaces)
    6
    """

    surfaces: Annotated[tuple[InstanceOf[Surface], ...], Field(min_length=1)]
    counts: Annotated[tuple[PositiveInt, ...], Field(min_length=1)]
    limits: tuple[Tension, Tension] = LIMITS
    fixed: tuple[InstanceOf[Module], ...] = ()
    rest: tuple[InstanceOf[RestPose], ...] = ()
    bodies: tuple[InstanceOf[Body], ...] = ()
    hardware: dict[Hardware, Any] = field(default_factory=dict)
    up: str | None = None
    platform: InstanceOf[Platform] | None = None
    required: InstanceOf[Requirement] = field(default_factory=Requirement)
    attachments: tuple[InstanceOf[Surface], ...] = ()
    symmetry: tuple[str, ...] = ()

    def __repr__(self) -> str:
        names = ", ".join(surface.name for surface in self.surfaces)
        fixed = f", {len(self.fixed)} fixed" if self.fixed else ""
        modules = " or ".join(map(str, self.counts))
        return f"<Space: {modules} modules{fixed} on {names}, {format_range(self.limits)} N>"

    def __post_init__(self) -> None:
        every = (*self.surfaces, *self.attachments)
        names, d = [surface.name for surface in every], self.dimension
        if repeated := [name for name in names if names.count(name) > 1]:
            raise RigError(f'surface "{repeated[0]}": its name is used twice; give each its own')
        sizes = {f'surface "{surface.name}"': surface.corner.size for surface in every}
        sizes |= {f'module "{module.name}"': module.anchor.size for module in self.fixed}
        for what, size in sizes.items():
            if size != d:
                raise RigError(f'{what}: has {size} coordinates and surface "{names[0]}" {d}; give both {d}')
        if pulleys := [module.name for module in self.fixed if module.pulley_radius is not None]:
            raise RigError(f'module "{pulleys[0]}": its pulley cannot be part of a search; leave it out')
        if worn := [surface.name for surface in self.attachments if surface.frame != WORLD]:
            raise RigError(f'surface "{worn[0]}": attachments are in the axes of the platform; leave frame out')
        if self.attachments and self.bodies:
            raise RigError("bodies: cables of a platform cannot be kept clear in a search; leave out the bodies")
        if len(set(self.counts)) < len(self.counts):
            raise RigError(f"counts is {brief(list(self.counts))}; give different numbers")
        lower, upper = self.limits
        if lower > upper:
            raise RigError(f"limits is {lower} to {upper}; give 0 <= lower <= upper, both in N")
        if self.symmetry and any(surface.frame != WORLD for surface in self.surfaces):
            raise RigError("symmetry: a surface is on a body, which has no images; leave one of them out")
        images = len(self.images)  # refuses words that are no symmetry
        if odd := [count for count in self.counts if count % images]:
            raise RigError(f"counts has {odd[0]}, but by its symmetry each cable has {images - 1} images; "
                           f"give multiples of {images}")  # fmt: skip
        _ = self.one_module, self.placed  # refuses wrong limits and hardware, and missing frames

    @property
    def dimension(self) -> int:
        """Dimension of space: 2 or 3."""
        return self.surfaces[0].corner.size

    @cached_property
    def images(self) -> Floats:
        """Matrices (g, d, d) that take a cable to its images by symmetry, the identity first."""
        d = self.dimension
        known = [*"xyz"[:d], *(f"{order}-fold" for order in range(2, MAX_ORDER + 1))]
        group = [np.eye(d)]
        for word in self.symmetry:
            if word not in known:
                raise RigError(f'symmetry has {brief(word)}; give "x", "y" or another axis, or "3-fold"')
            if word in "xyz":
                images = [np.eye(d), np.diag(np.where(np.arange(d) == "xyz".index(word), -1.0, 1.0))]
            elif d == 3 and self.up is None:
                raise RigError(f'symmetry has "{word}"; give up as well, the axis about which it turns')
            else:
                angles = 2 * np.pi * np.arange(order := int(word.partition("-")[0])) / order
                images = [*kinematics.planar_rotation(angles)]
                if d == 3 and self.up is not None:
                    images = [*kinematics.exponential(angles[:, None] * upward(self.up, d))]
            group = [one @ other for one, other in product(group, images)]
        return np.stack(group)

    @cached_property
    def placed(self) -> SurfaceGeometry:
        """Surfaces and fixed modules in world axes, attachments in those of the platform."""
        d, every = self.dimension, (*self.surfaces, *self.attachments)
        modules = [
            Module("end of an edge", surface.corner + edge, 0.0, 0.0, frame=surface.frame)
            for surface in every
            for edge in np.pad(surface.edges, ((1, d - len(surface.edges)), (0, 0)))  # the corner first
        ] + [*self.fixed]
        frames = {rest_pose.name: rest_pose.frame for rest_pose in self.rest}
        points = pose.place_anchors(modules, np.stack([module.anchor for module in modules]), frames)
        carrying = [module.frame for module in modules] + [body.frame for body in self.bodies]
        pose.require_known(frames, sorted({*carrying} - {WORLD}))
        ends = points[: len(every) * (1 + d)].reshape(-1, 1 + d, d)
        attached = np.array([module.attachment for module in self.fixed]).reshape(-1, d)
        fixed = np.stack([points[len(every) * (1 + d) :], attached], axis=1)
        return SurfaceGeometry(ends[:, 0], ends[:, 1:] - ends[:, :1], fixed if self.attachments else fixed[:, :1])

    @cached_property
    def length(self) -> float:
        """Length in m by which torques are divided, the same for all rigs of the space."""
        if not self.attachments or self.required.length is not None:
            return self.required.length or 1.0
        corners, edges, _ = (array[len(self.surfaces) :] for array in self.placed)
        shares = np.array([*product((0.0, 1.0), repeat=self.dimension)])
        vertices = corners[:, None] + np.einsum("ck,skd->scd", shares, edges)
        return float(np.sqrt(np.square(vertices).sum(axis=-1).mean())) or 1.0

    @property
    def divisors(self) -> Floats:
        """Divisors of the components of wrenches, (n,)."""
        return self.one_module.required.divisors(self.one_module)

    @cached_property
    def one_module(self) -> Rig:
        """Rig with one module at the origin, with all that the rigs of this space share."""
        origin = np.zeros(self.dimension)
        return self.rig("this space", [Module("any", origin, *self.limits, **self.hardware)], origin)

    def rig(self, name: str, modules: Sequence[Module], home: Floats) -> Rig:
        """Return a rig of this space with these modules."""
        used = {module.frame for module in modules} | {body.frame for body in self.bodies}
        kinds = ("planar", "platform") if self.attachments else ("planar-point", "point")
        return Rig(
            name,
            kind=kinds[self.dimension - 2],
            modules=tuple(modules),
            home=home,
            platform=self.platform,
            up=self.up,
            required=replace(self.required, length=self.length) if self.attachments else self.required,
            rest=tuple(rest_pose for rest_pose in self.rest if rest_pose.name in used),
            bodies=self.bodies,
            source="tensionlab layout search",
        )

    @property
    def ends(self) -> list[range]:
        """Indices of the surfaces for each end of a cable: its anchor and, on a platform, its attachment."""
        count, every = len(self.surfaces), len(self.surfaces) + len(self.attachments)
        return [range(count), range(count, every)] if self.attachments else [range(count)]

    def decode(self, genes: Floats) -> Placement:
        """Decode genes (..., k, e, d + 1), from 0 to 1, into places.

        The first gene of an end picks the surface, all of which are equally likely; the others are the shares of
        its edges.
        """
        first, count = np.array([(indices.start, len(indices)) for indices in self.ends]).T
        surfaces = first + np.minimum((genes[..., 0] * count).astype(np.int64), count - 1)
        return Placement(surfaces, np.clip(genes[..., 1:] * (1 + 2 * GENE_BORDER) - GENE_BORDER, 0.0, 1.0))

    def cables(self, places: Placement) -> Floats:
        """Return the ends of all cables, (..., m, e, d), in m, with the images of each and the fixed ones last."""
        placed = self.placed
        moved = np.einsum("...k,...kd->...d", places.along, placed.edges[places.surfaces])
        put = placed.corners[places.surfaces] + moved
        images = (
            np.einsum("gij,...kej->...kgei", self.images, put) if len(self.images) > 1 else put[..., None, :, :]
        )
        put = images.reshape(*put.shape[:-3], -1, *put.shape[-2:])
        fixed = np.broadcast_to(placed.fixed, (*put.shape[:-3], *placed.fixed.shape))
        return np.concatenate([put, fixed], axis=-3)

    def tension_limits(self, count: int) -> TensionLimits:
        """Return the tension limits of ``count`` modules and the fixed ones, which are last."""
        limits = [self.limits] * count + [(module.lower, module.upper) for module in self.fixed]
        return TensionLimits(*np.array(limits, float).T)
