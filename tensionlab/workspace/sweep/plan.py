"""Plan of a sweep: its configurations, its axes and chunks, and the task that evaluates one chunk."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import RigError, SweepError
from tensionlab.model import kinematics, layouts, pose
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, as_floats
from tensionlab.workspace.metrics import Batch, Metric
from tensionlab.workspace.poses import Coordinate, Poses


@dataclass(frozen=True, eq=False)
class Axis:
    """Parameter that differs between the rigs: its name, its values, and their labels."""

    name: str
    values: tuple[Any, ...]
    coordinates: tuple[Coordinate, ...]


@dataclass(frozen=True, eq=False)
class Configurations:
    """Every combination of the values of some axes; ``make`` returns the rig with one value for each axis."""

    axes: tuple[Axis, ...]
    make: Callable[..., Rig]

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def rig(self, index: Sequence[int]) -> Rig:
        """Return the rig with these indices along the axes."""
        return self.make(*(axis.values[i] for axis, i in zip(self.axes, index, strict=True)))

    def coordinates(self) -> list[Coordinate]:
        """Return the labels of the axes."""
        return [coordinate for axis in self.axes for coordinate in axis.coordinates]


def vary(
    what: Rig | Sequence[Rig] | Callable[..., Rig],
    *,
    anchors: Mapping[str, ArrayLike] | None = None,
    limits: Sequence[tuple[float, float]] | None = None,
    **parameters: Any,
) -> Configurations:
    """Return the rigs of every combination of these values.

    The axes are "rig" or one for each listed parameter, "anchor_NAME" for each module (spaces become _), and
    "limits". ``vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4, 5, 6, 8], limits=[(0.5, 6), (0.5, 12)])``
    are 20 rigs. SweepError names the argument: no values, values of no use, names that are not the layout's.

    Parameters
    ----------
    what : Rig, sequence of Rig, or callable
        Rigs with names that differ, or a layout: a function whose arguments are the parameters.
    anchors : mapping of module name to (k, d) array, optional
        Places to try for the anchor of a module, in the axes of its frame, in m. Every rig has that module.
    limits : sequence of (lower, upper), optional
        Tension limits to try, the same for all modules, in N.
    **parameters
        Of the layout: a list of the values to try, or one value that stays.

    Examples
    --------
    >>> import tensionlab as tl
    >>> configurations = tl.workspace.vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4, 5])
    >>> swept = tl.sweep(configurations, [[0.0, 0.3, 0.0]], "capacity-margin", progress=False)
    >>> dict(swept["capacity-margin"].sizes)
    {'side': 2, 'count': 3, 'pose': 1}
    """
    axes, make = _layout(what, parameters) if callable(what) else _rigs(what, parameters)
    first = len(axes)
    moved = dict(anchors or {})
    for name, points in moved.items():
        places = _rows(f"anchors[{name!r}]", points, "places, each a list of coordinates in m")
        title = f'anchor of module "{name}"'
        axes.append(_axis("_".join(["anchor", *name.split()]), [tuple(place) for place in places], "m", title))
    if limits is not None:
        pairs = _rows("limits", limits, "pairs (lower, upper) in N")
        if pairs.shape[1] != 2:
            raise SweepError(f"vary: limits is {limits!r}; give pairs (lower, upper) in N")
        axes.append(_axis("limits", [tuple(pair) for pair in pairs], "N", "tension limits", ("lower", "upper")))

    def configure(*values: Any) -> Rig:
        rig = make(*values[:first])
        for name, anchor in zip(moved, values[first:], strict=False):
            rig = _move(rig, name, anchor)
        if limits is not None:
            lower, upper = values[-1]
            rig = replace(rig, modules=tuple(replace(each, lower=lower, upper=upper) for each in rig.modules))
        return rig

    return Configurations(tuple(axes), configure)


def _rigs(what: Rig | Sequence[Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return the axis "rig", and a function that makes a rig of its value."""
    if parameters:
        raise SweepError(f"vary: {next(iter(parameters))!r} is the parameter of a layout, and this is no layout")
    rigs = [what] if isinstance(what, Rig) else list(what)
    if not rigs:
        raise SweepError("rigs is empty; give at least one rig")
    for each in rigs:
        if not isinstance(each, Rig):
            raise SweepError(f"rigs holds {each!r}; give rigs, such as tl.load_rig returns, or what vary returns")
    names = [each.name for each in rigs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SweepError(f'two rigs are called "{twice[0]}"; give each its own name')
    label = Coordinate("rig", ("rig",), np.array(names), "1", "name of the rig")
    return [Axis("rig", tuple(rigs), (label,))], lambda rig: rig


def _layout(what: Callable[..., Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return an axis for each parameter with several values, and a function that makes the rig."""
    title = getattr(what, "__name__", "the layout")
    known = inspect.signature(what).parameters
    if unknown := [name for name in parameters if name not in known]:
        raise SweepError(f"vary: {title} has no parameter {unknown[0]!r}; it has {', '.join(known)}")
    if needed := [name for name, each in known.items() if each.default is each.empty and name not in parameters]:
        raise SweepError(f"vary: {title} needs {needed[0]!r}; give a value, or a list of values to try")
    axes, fixed = [], {}
    for name, values in parameters.items():
        if isinstance(values, str) or not isinstance(values, (Sequence, np.ndarray)):
            fixed[name] = values
            continue
        listed = list(values)
        if not listed:
            raise SweepError(f"vary: {name} holds no values; give at least one")
        counts = all(isinstance(value, (int, np.integer)) for value in listed)
        unit = layouts.UNITS.get(name, "1" if counts else "SI")
        axes.append(_axis(name, listed, unit, f"{name} of {title}"))
    names = [axis.name for axis in axes]
    return axes, lambda *values: what(**fixed, **dict(zip(names, values, strict=True)))


def _axis(name: str, values: list[Any], unit: str, title: str, parts: Sequence[str] = "xyz") -> Axis:
    """Return an axis: numbers and texts label themselves, points have a number and coordinates."""
    if all(isinstance(value, str) for value in values):
        return Axis(name, tuple(values), (Coordinate(name, (name,), np.array(values), "1", title),))
    try:
        table = np.array([np.nan if value is None else value for value in values])
    except ValueError:
        table = np.array(None)
    if table.dtype.kind not in "biuf" or table.ndim not in (1, 2):
        raise SweepError(f"vary: {name} is {values!r}; give numbers, texts, or points of one dimension")
    if table.ndim == 1:
        return Axis(name, tuple(values), (Coordinate(name, (name,), table, unit, title),))
    labels = [Coordinate(name, (name,), np.arange(len(values)), "1", f"number of the {title}")]
    for i, column in enumerate(table.T):
        part = parts[i] if i < len(parts) else str(i)
        labels.append(Coordinate(f"{name}_{part}", (name,), column, unit, f"{part} of the {title}"))
    return Axis(name, tuple(values), tuple(labels))


def _rows(what: str, values: ArrayLike, expected: str) -> Floats:
    """Return a table of numbers, a row for each value."""
    try:
        table = as_floats(what, values)
    except (TypeError, ValueError):
        table = np.empty(0)
    if table.ndim != 2 or table.size == 0:
        raise SweepError(f"vary: {what} is {values!r}; give a list of {expected}")
    return table


def _move(rig: Rig, name: str, anchor: Any) -> Rig:
    """Return the rig with one anchor elsewhere."""
    if name not in (module.name for module in rig.modules):
        names = ", ".join(module.name for module in rig.modules)
        raise RigError(f'rig "{rig.name}" has no module "{name}" to move; it has {names}')
    modules = tuple(replace(each, anchor=anchor) if each.name == name else each for each in rig.modules)
    return replace(rig, modules=modules)


Block = tuple[slice, ...]
"""A part of every axis of a sweep."""

MIN_LENGTH_RATIO = 1e-12
"""A cable shorter than this share of the longest one is at its anchor but for rounding, and has no direction."""
PART_ENTRIES = 1 << 17
"""Entries of the structure matrices that are evaluated together: 1 MB stays in a processor's cache."""
MIN_CHUNKS = 16
"""Chunks of a small sweep, at least, so that all processors have work."""
MIN_CHUNK_VALUES = 1_024
"""Values of a chunk that is not worth cutting up."""


@dataclass(frozen=True, eq=False)
class Task:
    """One chunk of a sweep, with all that it takes to evaluate it: small enough to send to another machine."""

    number: int
    block: Block
    rigs: tuple[Rig, ...]
    poses: Poses
    metrics: tuple[Metric, ...]
    frames: Frames
    required: tuple[Requirement, ...]
    """Of each rig."""

    def evaluate(self) -> Floats:
        """Return the values, (metrics, *shape of the block); NaN where a cable has no length."""
        position, rotation = self.poses.arrays()
        values = np.full((len(self.metrics), len(self.rigs), len(position)), np.nan)
        for number, rig in enumerate(self.rigs):
            step = max(1, PART_ENTRIES // (rig.n * rig.m))
            for start in range(0, len(position), step):
                part = slice(start, start + step)
                turn = None if rotation is None else rotation[part]
                batch, sound = _batch(rig, position[part], turn, self.frames, self.required[number])
                for row, metric in enumerate(self.metrics):
                    values[row, number, part][sound] = metric.evaluate(batch)
        return values.reshape(len(self.metrics), *(part.stop - part.start for part in self.block))


@dataclass(frozen=True, eq=False)
class Plan:
    """Every metric, of every configuration, at every pose, in chunks of at most so many values.

    The axes are those of the configurations, then those of the poses. What is required is each rig's own where it
    is None.
    """

    configurations: Configurations
    poses: Poses
    metrics: Mapping[str, Metric]
    frames: Frames
    chunk: int
    required: Requirement | None = None

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        return self.configurations.dims + self.poses.dims

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return self.configurations.shape + self.poses.shape

    @cached_property
    def chunks(self) -> tuple[int, ...]:
        """Length of a chunk along each axis: as much of the last axes as fits, then of those before."""
        found: list[int] = []
        left = min(self.chunk, max(MIN_CHUNK_VALUES, math.prod(self.shape) // MIN_CHUNKS))
        for length in reversed(self.shape):
            found.append(min(length, max(left, 1)))
            left //= found[-1]
        return tuple(reversed(found))

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """Number of chunks along each axis."""
        return tuple(-(-length // part) for length, part in zip(self.shape, self.chunks, strict=True))

    def block(self, number: int) -> Block:
        """Return the part of every axis that is the chunk of a number; the last axis runs fastest."""
        tile = np.unravel_index(number, self.tiles)
        return tuple(
            slice(int(i) * part, min((int(i) + 1) * part, length))
            for i, part, length in zip(tile, self.chunks, self.shape, strict=True)
        )

    def size(self, number: int) -> int:
        """Return how many values of a metric the chunk of a number has."""
        return math.prod(part.stop - part.start for part in self.block(number))

    def task(self, number: int) -> Task:
        """Return the task that evaluates the chunk of a number."""
        block = self.block(number)
        count = len(self.configurations.shape)
        rigs = tuple(
            self.configurations.rig([part.start + i for i, part in zip(index, block[:count], strict=True)])
            for index in np.ndindex(*(part.stop - part.start for part in block[:count]))
        )
        poses, metrics = self.poses.block(block[count:]), tuple(self.metrics.values())
        return Task(number, block, rigs, poses, metrics, self.frames, tuple(map(self.requirement, rigs)))

    def requirement(self, rig: Rig) -> Requirement:
        """Return what is required of a rig."""
        return rig.required if self.required is None else self.required

    def check(self, rig: Rig) -> None:
        """Refuse a rig that does not suit the poses, or that a metric refuses.

        For its dimensions, no body to turn, a body frame that is not given, required wrenches of another size, or
        more cables than a metric takes.
        """
        if rig.dimension != self.poses.dimension:
            raise SweepError(
                f"the poses have {self.poses.dimension} coordinates; "
                f'rig "{rig.name}" ({rig.kind}) needs {rig.dimension}; give it other poses, or a sweep of its own'
            )
        one = self.poses.block(tuple(slice(0, 1) for _ in self.poses.shape))
        position, rotation = one.arrays()
        if rotation is not None and rig.n == rig.dimension:
            raise SweepError(
                f'the poses have orientations, and rig "{rig.name}" ({rig.kind}) cannot turn; leave them out'
            )
        nothing = None if rotation is None else rotation[:0]
        batch, _ = _batch(rig, position[:0], nothing, self.frames, self.requirement(rig))
        batch.required.check_rig(rig)
        for metric in self.metrics.values():
            metric.evaluate(batch)


def _batch(
    rig: Rig, position: Floats, rotation: Floats | None, frames: Frames, required: Requirement
) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the poses of a rig whose cables have a length, and which of those given they are."""
    own = {name: frames[name] for name in rig.frames if name in frames}
    anchors = pose.place_anchors(rig.modules, rig.anchors, own)
    attachments = rig.attachments if rig.n > rig.dimension else None
    turn = kinematics.planar_rotation(rotation) if rotation is not None and rig.dimension == 2 else rotation
    radii, axes = rig.pulleys_in_world(own) or (None, None)
    structure, sound = _native.structure_matrices(
        anchors, attachments, position, turn, radii, axes, MIN_LENGTH_RATIO
    )
    if not sound.all():
        position, structure = position[sound], structure[sound]
        rotation = None if rotation is None else rotation[sound]
    return Batch(rig, position, rotation, own, structure, required), sound
