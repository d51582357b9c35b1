"""What a sweep is to do: its axes, its chunks, and the task that evaluates one chunk anywhere."""

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
from tensionlab.workspace.base import Batch, Measure
from tensionlab.workspace.sweep.configurations import Configurations
from tensionlab.workspace.sweep.pose_sets import Poses

Block = tuple[slice, ...]
"""A part of every axis of a sweep."""

NO_LENGTH = 1e-12
"""A cable shorter than this share of the longest one is at its anchor but for rounding, and has no direction."""

PARTS = 16
"""Chunks of a small sweep, at least, so that all processors have work."""

SMALL = 1_024
"""Values of a chunk that is not worth cutting up."""


@dataclass(frozen=True, eq=False)
class Task:
    """One chunk of a sweep, with all that it takes to evaluate it: small enough to send to another machine."""

    number: int
    block: Block
    rigs: tuple[Rig, ...]
    poses: Poses
    measures: tuple[Measure, ...]
    frames: Frames

    def evaluate(self) -> Floats:
        """What are the measures, (measures, *shape of the block)? NaN where a cable has no length."""
        position, rotation = self.poses.arrays()
        values = np.full((len(self.measures), len(self.rigs), len(position)), np.nan)
        for number, rig in enumerate(self.rigs):
            batch, sound = _batch(rig, position, rotation, self.frames)
            for row, measure in enumerate(self.measures):
                values[row, number, sound] = measure.evaluate(batch)
        return values.reshape(len(self.measures), *(part.stop - part.start for part in self.block))


@dataclass(frozen=True, eq=False)
class Plan:
    """Every measure, of every configuration, at every pose, cut into chunks of at most so many values.

    The axes are those of the configurations, then those of the poses.
    """

    configurations: Configurations
    poses: Poses
    measures: Mapping[str, Measure]
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
        left = min(self.chunk, max(SMALL, math.prod(self.shape) // PARTS))
        for length in reversed(self.shape):
            found.append(min(length, max(left, 1)))
            left //= found[-1]
        return tuple(reversed(found))

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """Number of chunks along each axis."""
        return tuple(-(-length // part) for length, part in zip(self.shape, self.chunks, strict=True))

    def block(self, number: int) -> Block:
        """Which part of every axis is the chunk of this number? The last axis runs fastest."""
        tile = np.unravel_index(number, self.tiles)
        return tuple(
            slice(int(i) * part, min((int(i) + 1) * part, length))
            for i, part, length in zip(tile, self.chunks, self.shape, strict=True)
        )

    def size(self, number: int) -> int:
        """How many values of a measure has the chunk of this number?"""
        return math.prod(part.stop - part.start for part in self.block(number))

    def task(self, number: int) -> Task:
        """Which task evaluates the chunk of this number?"""
        block = self.block(number)
        count = len(self.configurations.shape)
        rigs = tuple(
            self.configurations.rig([part.start + i for i, part in zip(index, block[:count], strict=True)])
            for index in np.ndindex(*(part.stop - part.start for part in block[:count]))
        )
        return Task(
            number, block, rigs, self.poses.block(block[count:]), tuple(self.measures.values()), self.frames
        )

    def check(self, rig: Rig) -> None:
        """Refuse a rig that cannot stand at the poses, or that a measure refuses.

        Raises
        ------
        SweepError, RigError, ShapeError
            Other dimensions, no body to turn, a body frame that is not given, more cables than a measure takes.
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
        for measure in self.measures.values():
            measure.evaluate(batch)


def _batch(rig: Rig, position: Floats, rotation: Floats | None, frames: Frames) -> tuple[Batch, NDArray[np.bool_]]:
    """Poses of a rig ready to be measured, and which of those given they are: all whose cables have a length."""
    own = {name: frames[name] for name in rig.frames if name in frames}
    anchors = pose.place_anchors(rig.modules, rig.anchors, own)
    arms = None
    if rig.n > rig.dimension:
        turn = kinematics.planar_rotation(rotation) if rotation is not None and rig.dimension == 2 else rotation
        arms = rig.attachments if turn is None else kinematics.rotate(turn, rig.attachments)
    lengths, directions = kinematics.cables(anchors, position, arms)
    sound = np.asarray((lengths > NO_LENGTH * lengths.max(axis=-1, keepdims=True)).all(axis=-1))
    structure = kinematics.structure_matrix(directions, arms)
    if not sound.all():
        position, structure = position[sound], structure[sound]
        rotation = None if rotation is None else rotation[sound]
    return Batch(rig, position, rotation, own, structure), sound
