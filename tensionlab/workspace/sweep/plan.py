"""Plan of a sweep: its axes, its chunks, and the task that evaluates one chunk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.errors import SweepError
from tensionlab.model import kinematics, pose
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.workspace.metrics import Batch, Metric
from tensionlab.workspace.poses import Poses
from tensionlab.workspace.sweep.configurations import Configurations

Block = tuple[slice, ...]
"""A part of every axis of a sweep."""

MIN_LENGTH_RATIO = 1e-12
"""A cable shorter than this share of the longest one is at its anchor but for rounding, and has no direction."""
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

    def evaluate(self) -> Floats:
        """Return the values, (metrics, *shape of the block); NaN where a cable has no length."""
        position, rotation = self.poses.arrays()
        values = np.full((len(self.metrics), len(self.rigs), len(position)), np.nan)
        for number, rig in enumerate(self.rigs):
            batch, sound = _batch(rig, position, rotation, self.frames)
            for row, metric in enumerate(self.metrics):
                values[row, number, sound] = metric.evaluate(batch)
        return values.reshape(len(self.metrics), *(part.stop - part.start for part in self.block))


@dataclass(frozen=True, eq=False)
class Plan:
    """Every metric, of every configuration, at every pose, in chunks of at most so many values.

    The axes are those of the configurations, then those of the poses.
    """

    configurations: Configurations
    poses: Poses
    metrics: Mapping[str, Metric]
    frames: Frames
    chunk: int

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
        return Task(
            number, block, rigs, self.poses.block(block[count:]), tuple(self.metrics.values()), self.frames
        )

    def check(self, rig: Rig) -> None:
        """Refuse a rig that does not suit the poses, or that a metric refuses.

        For its dimensions, no body to turn, a body frame that is not given, or more cables than a metric takes.
        """
        if rig.dimension != self.poses.dimension:
            raise SweepError(
                f"the poses have {self.poses.dimension} coordinates; "
                f'rig "{rig.name}" ({rig.kind}) needs {rig.dimension}'
            )
        one = self.poses.block(tuple(slice(0, 1) for _ in self.poses.shape))
        position, rotation = one.arrays()
        if rotation is not None and rig.n == rig.dimension:
            raise SweepError(f'the poses have orientations, and rig "{rig.name}" ({rig.kind}) cannot turn')
        nothing = None if rotation is None else rotation[:0]
        batch, _ = _batch(rig, position[:0], nothing, self.frames)
        for metric in self.metrics.values():
            metric.evaluate(batch)


def _batch(rig: Rig, position: Floats, rotation: Floats | None, frames: Frames) -> tuple[Batch, NDArray[np.bool_]]:
    """Return the poses of a rig whose cables have a length, and which of those given they are."""
    own = {name: frames[name] for name in rig.frames if name in frames}
    anchors = pose.place_anchors(rig.modules, rig.anchors, own)
    arms = None
    if rig.n > rig.dimension:
        turn = kinematics.planar_rotation(rotation) if rotation is not None and rig.dimension == 2 else rotation
        arms = rig.attachments if turn is None else kinematics.rotate(turn, rig.attachments)
    lengths, directions = kinematics.cables(anchors, position, arms)
    sound = np.asarray((lengths > MIN_LENGTH_RATIO * lengths.max(axis=-1, keepdims=True)).all(axis=-1))
    structure = kinematics.structure_matrix(directions, arms)
    if not sound.all():
        position, structure = position[sound], structure[sound]
        rotation = None if rotation is None else rotation[sound]
    return Batch(rig, position, rotation, own, structure), sound
