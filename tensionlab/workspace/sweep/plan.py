"""Plan of a sweep: its axes and chunks, and the task that evaluates one chunk."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import SweepError
from tensionlab.model import kinematics, pose
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace.metrics import Batch, Metric
from tensionlab.workspace.poses import Poses
from tensionlab.workspace.sweep.configurations import Configurations

Block = tuple[slice, ...]  # a part of every axis of a sweep

MIN_LENGTH_RATIO = 1e-12  # to the longest cable; a shorter one is at its anchor but for rounding: no direction
PART_ENTRIES = 1 << 17  # entries of structure matrices evaluated together: 1 MB stays in a processor's cache
MIN_CHUNKS = 16  # of a small sweep, so that all processors have work
MIN_CHUNK_VALUES = 1_024  # a smaller chunk is not worth its overhead


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
        values = np.full((len(self.metrics), len(self.rigs), len(position)), np.nan)
        for number, (rig, required) in enumerate(zip(self.rigs, self.required, strict=True)):
            frames = {name: self.frames[name] for name in rig.frames}
            step = max(1, PART_ENTRIES // (rig.n * rig.m))
            for part in (slice(start, start + step) for start in range(0, len(position), step)):
                turn = None if rotation is None else rotation[part]
                batch, sound = _batch(rig, position[part], turn, frames, required)
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

    def own_frames(self, rig: Rig) -> Frames:
        """Return the poses of a rig's body frames."""
        return {name: self.frames[name] for name in rig.frames if name in self.frames}

    def check(self, rig: Rig) -> None:
        """Refuse a rig that cannot turn as the poses do, lacks a body frame, or that a metric refuses."""
        position, rotation = self.poses.block(tuple(slice(0, 1) for _ in self.poses.shape)).arrays()
        if rotation is not None and rig.n == rig.dimension:
            raise SweepError(
                f'the poses have orientations, and rig "{rig.name}" ({rig.kind}) cannot turn; leave them out'
            )
        turns = None if rotation is None else rotation[:0]
        batch, _ = _batch(rig, position[:0], turns, self.own_frames(rig), self.requirement(rig))
        batch.required.check_rig(rig)
        for metric in self.metrics:
            metric.evaluate(batch)


def _batch(
    rig: Rig, position: Floats, rotation: Floats | None, frames: Frames, required: Requirement
) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the poses of a rig whose cables have a length, and which of those given they are."""
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    attachments = rig.attachments if rig.n > rig.dimension else None
    turn = kinematics.planar_rotation(rotation) if rotation is not None and rig.dimension == 2 else rotation
    radii, axes = rig.pulleys_in_world(frames) or (None, None)
    structure, sound = _native.structure_matrices(
        anchors, attachments, position, turn, radii, axes, MIN_LENGTH_RATIO
    )
    if not sound.all():
        position, structure = position[sound], structure[sound]
        rotation = None if rotation is None else rotation[sound]
    return Batch(rig, position, rotation, frames, structure, required), sound
