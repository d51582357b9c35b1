"""Plan of a sweep: configurations of rigs (`vary`), its axes and chunks, and the task that evaluates a chunk."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import SweepError
from tensionlab.model import kinematics, layouts, pose
from tensionlab.model.module import KINDS
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, as_floats, pad_last_axis
from tensionlab.workspace.metrics import Batch, Metric
from tensionlab.workspace.poses import Label, PoseList, Poses, label

Block = tuple[slice, ...]  # a part of every axis of a sweep

MIN_LENGTH_RATIO = 1e-12  # to the longest cable; a shorter one is at its anchor but for rounding: no direction
PART_ENTRIES = 1 << 17  # entries of structure matrices evaluated together: 1 MB stays in a processor's cache
MIN_CHUNKS = 16  # of a small sweep, so that all processors have work
MIN_CHUNK_VALUES = 1_024  # a smaller chunk is not worth its overhead


class Axis(NamedTuple):
    """Parameter that differs between the rigs: its name, its values, and their labels."""

    name: str
    values: tuple[Any, ...]
    labels: dict[str, Label]


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

    def rigs(self) -> Iterator[Rig]:
        """Yield the rig of every combination; the last axis runs fastest."""
        return (self.rig(index) for index in np.ndindex(*self.shape))

    def labels(self) -> dict[str, Label]:
        """Return the labels of the axes."""
        return {name: variable for axis in self.axes for name, variable in axis.labels.items()}


def vary(
    what: Rig | Sequence[Rig] | Callable[..., Rig],
    *,
    limits: Sequence[tuple[float, float]] | None = None,
    **parameters: Any,
) -> Configurations:
    """Return the rigs of every combination of these values.

    The axes are "rig" or one for each listed parameter, and "limits". SweepError names an argument without values,
    with invalid values, or that the layout does not have.

    Parameters
    ----------
    what : Rig, sequence of Rig, or callable
        Rigs with names that differ, or a layout: a function whose arguments are the parameters.
    limits : sequence of (lower, upper), optional
        Tension limits to try, the same for all modules, in N.
    **parameters
        Parameters of the layout: a list of values to try, or one fixed value.

    Examples
    --------
    >>> import tensionlab as tl
    >>> configurations = tl.workspace.vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4, 5])
    >>> swept = tl.sweep(configurations, [[0.0, 0.3, 0.0]], "capacity-margin")
    >>> dict(swept["capacity-margin"].sizes)
    {'side': 2, 'count': 3, 'pose': 1}
    """
    axes, make = _layout(what, parameters) if callable(what) else _rigs(what, parameters)
    if limits is None:
        return Configurations(tuple(axes), make)
    pairs = as_floats("limits", limits)
    if pairs.ndim != 2 or pairs.size == 0 or pairs.shape[1] != 2:
        raise SweepError(f"vary: limits is {limits!r}; give a list of pairs (lower, upper) in N")
    axes.append(_axis("limits", pairs.tolist(), "N", "tension limits", ("lower", "upper")))

    def configure(*values: Any) -> Rig:
        *others, (lower, upper) = values
        rig = make(*others)
        return replace(rig, modules=tuple(replace(module, lower=lower, upper=upper) for module in rig.modules))

    return Configurations(tuple(axes), configure)


def _rigs(what: Rig | Sequence[Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return the axis "rig", and a function that makes a rig of its value."""
    if parameters:
        raise SweepError(f"vary: {next(iter(parameters))!r} is the parameter of a layout, and this is no layout")
    rigs = [what] if isinstance(what, Rig) else list(what)
    if not rigs:
        raise SweepError("rigs is empty; give at least one rig")
    if other := [rig for rig in rigs if not isinstance(rig, Rig)]:
        raise SweepError(f"rigs holds {other[0]!r}; give rigs, such as tl.load_rig returns, or what vary returns")
    names = [rig.name for rig in rigs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SweepError(f'two rigs are called "{twice[0]}"; give each its own name')
    labels = {"rig": label(("rig",), np.array(names), "1", "name of the rig")}
    return [Axis("rig", tuple(rigs), labels)], lambda rig: rig


def _layout(what: Callable[..., Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return an axis for each parameter with several values, and a function that makes the rig."""
    title = getattr(what, "__name__", "the layout")
    signature = inspect.signature(what)
    try:
        signature.bind(**parameters)
    except TypeError as error:
        known = ", ".join(signature.parameters)
        raise SweepError(f"vary: {title}: {error}; its parameters are {known}") from None
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


def _axis(name: str, values: Sequence[Any], unit: str, title: str, parts: Sequence[str] = "xyz") -> Axis:
    """Return an axis: numbers and texts label themselves, points have a number and coordinates."""
    if all(isinstance(value, str) for value in values):
        return Axis(name, tuple(values), {name: label((name,), np.array(values), "1", title)})
    try:
        table = np.array([np.nan if value is None else value for value in values])
    except ValueError:
        table = np.array(None)
    if table.dtype.kind not in "biuf" or table.ndim not in (1, 2):
        raise SweepError(f"vary: {name} is {values!r}; give numbers, texts, or points of one dimension")
    if table.ndim == 1:
        return Axis(name, tuple(values), {name: label((name,), table, unit, title)})
    labels = {name: label((name,), np.arange(len(values)), "1", f"number of the {title}")}
    for i, column in enumerate(table.T):
        part = parts[i] if i < len(parts) else str(i)
        labels[f"{name}_{part}"] = label((name,), column, unit, f"{part} of the {title}")
    return Axis(name, tuple(values), labels)


@dataclass(frozen=True, eq=False)
class ChunkTask:
    """One chunk of a sweep, with all its data: small enough to send to another machine."""

    number: int
    block: Block
    rigs: tuple[Rig, ...]
    poses: Poses
    metrics: tuple[Metric, ...]
    frames: Frames
    required: tuple[Requirement, ...]  # of each rig

    def evaluate(self) -> Floats:
        """Return the values, (metrics, *shape of the block); NaN where a cable has no length."""
        position, rotation = self.poses.arrays()
        wrench = self.poses.wrench if isinstance(self.poses, PoseList) else None
        values = np.full((len(self.metrics), len(self.rigs), len(position)), np.nan)
        for number, (rig, required) in enumerate(zip(self.rigs, self.required, strict=True)):
            frames = own_frames(rig, self.frames)
            step = max(1, PART_ENTRIES // (rig.n * rig.m))
            for part in (slice(start, start + step) for start in range(0, len(position), step)):
                turn, added = (None if array is None else array[part] for array in (rotation, wrench))
                batch, sound = _batch(rig, position[part], turn, frames, required)
                if added is not None:
                    batch = replace(batch, added=pad_last_axis(added[sound], rig.n))
                for row, metric in enumerate(self.metrics):
                    values[row, number, part][sound] = metric.evaluate(batch)
        return values.reshape(len(self.metrics), *(part.stop - part.start for part in self.block))


@dataclass(frozen=True, eq=False)
class Plan:
    """Every metric of every configuration at every pose, in chunks of a largest size.

    The axes are those of the configurations, then those of the poses. Without ``required``, it is each rig's own.
    """

    configurations: Configurations
    poses: Poses
    metrics: tuple[Metric, ...]
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
        lengths: list[int] = []
        remaining = min(self.chunk, max(MIN_CHUNK_VALUES, math.prod(self.shape) // MIN_CHUNKS))
        for length in reversed(self.shape):
            lengths.append(min(length, max(remaining, 1)))
            remaining //= lengths[-1]
        return tuple(reversed(lengths))

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """Number of chunks along each axis."""
        return tuple(-(-length // part) for length, part in zip(self.shape, self.chunks, strict=True))

    def block(self, number: int) -> Block:
        """Return the part of every axis that is the chunk of a number; the last axis runs fastest."""
        tile = map(int, np.unravel_index(number, self.tiles))
        return tuple(
            slice(i * part, min((i + 1) * part, length))
            for i, part, length in zip(tile, self.chunks, self.shape, strict=True)
        )

    def task(self, number: int) -> ChunkTask:
        """Return the task that evaluates the chunk of a number."""
        block = self.block(number)
        count = len(self.configurations.shape)
        indices = product(*(range(part.start, part.stop) for part in block[:count]))
        rigs = tuple(map(self.configurations.rig, indices))
        required = tuple(map(self.requirement, rigs))
        return ChunkTask(number, block, rigs, self.poses.block(block[count:]), self.metrics, self.frames, required)

    def requirement(self, rig: Rig) -> Requirement:
        """Return the required wrenches of a rig."""
        return rig.required if self.required is None else self.required

    def check(self, rig: Rig) -> None:
        """Refuse a rig that cannot turn as the poses do, lacks a body frame, or that a metric refuses."""
        position, rotation = self.poses.block(tuple(slice(0, 1) for _ in self.poses.shape)).arrays()
        if rotation is not None and not KINDS[rig.kind].has_orientation:
            raise SweepError(f'the poses have orientations; rig "{rig.name}" cannot turn; leave them out')
        wrench = getattr(self.poses, "wrench", None)
        if wrench is not None and wrench.shape[1] > rig.n:
            raise SweepError(f'the poses have torques; rig "{rig.name}" cannot turn; leave them out')
        turns = None if rotation is None else rotation[:0]
        batch, _ = _batch(rig, position[:0], turns, own_frames(rig, self.frames), self.requirement(rig))
        batch.required.check_rig(rig)
        for metric in self.metrics:
            metric.evaluate(batch)


def own_frames(rig: Rig, frames: Frames) -> dict[str, Any]:
    """Return the poses of a rig's own body frames."""
    return {name: frames[name] for name in rig.at_rest if name in frames}


def _batch(
    rig: Rig, position: Floats, rotation: Floats | None, frames: Frames, required: Requirement
) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the poses of a rig whose cables have a length, and which of those given they are."""
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    kind = KINDS[rig.kind]
    attachments = rig.attachments if kind.has_orientation else None
    if not kind.has_position and (position != rig.home).any():
        raise SweepError(f'rig "{rig.name}" is spherical and turns about its home; give that as every position')
    turn = kinematics.planar_rotation(rotation) if rotation is not None and rig.dimension == 2 else rotation
    if rotation is None and rig.home_rotation is not None:
        turn = np.tile(rig.home_matrix, (len(position), 1, 1))
    radii, axes = rig.pulleys_in_world(frames) or (None, None)
    structure, sound = _native.structure_matrices(
        anchors, attachments, position, turn, radii, axes, MIN_LENGTH_RATIO
    )
    if not kind.has_position:
        structure = np.ascontiguousarray(structure[:, rig.dimension :])
    if not sound.all():
        position, structure = position[sound], structure[sound]
        rotation = None if rotation is None else rotation[sound]
    return Batch(rig, position, rotation, frames, structure, required), sound
