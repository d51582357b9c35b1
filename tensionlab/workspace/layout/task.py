"""A search for a layout, as a TOML file asks for it: `load_task`."""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tensionlab.errors import RigError, ShapeError
from tensionlab.files.reading import brief, read_toml
from tensionlab.model import kinematics
from tensionlab.model.module import MAX_LENGTH, Module
from tensionlab.model.pose import Frame
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.result import LayoutSearch
from tensionlab.workspace.layout.search import Told, search_layout
from tensionlab.workspace.layout.space import Space, Surface, room
from tensionlab.workspace.paths import box
from tensionlab.workspace.sweep.pose_sets import Grid

if TYPE_CHECKING:
    from tensionlab.workspace.layout.schema import FrameTable, SpaceFile

MAX_ROTATION_RAD = 100.0
"""Of a frame, about each axis: beyond some turns an angle is a mistake."""
MAX_POSES = 1_000_000
"""Positions of a target: a search looks at each of them thousands of times."""


class LayoutTask(NamedTuple):
    """Which layout is asked for, and how long to search?

    The attributes are the arguments of `search_layout`.
    """

    name: str
    space: Space
    target: Grid
    objective: Objective
    seed: int
    generations: int
    starts: int

    def run(self, progress: Told | None = None) -> LayoutSearch:
        """Search for it; ``progress`` is told the share of the work that is done."""
        return search_layout(
            self.space,
            self.target,
            self.objective,
            name=self.name,
            seed=self.seed,
            generations=self.generations,
            starts=self.starts,
            progress=progress,
        )


def load_task(path: str | PathLike[str]) -> LayoutTask:
    """Which layout does a TOML file ask for?

    The format, with every key, is shown in ``datasets/README.md``.

    Raises
    ------
    RigError
        Naming the file, the table and the key: what is wrong and what to do.
    """
    from tensionlab.workspace.layout import schema

    document = read_toml(path, "a space file (*.toml)", RigError)
    try:
        table = schema.parse(document)
        return LayoutTask(
            name=table.name,
            space=_space(table),
            target=_target(table),
            objective=Objective(table.objective.force),
            **table.search.model_dump(),
        )
    except (RigError, ShapeError) as error:
        raise RigError(f"{path}: {error}") from None


def _space(table: SpaceFile) -> Space:
    surfaces = [Surface(**each.model_dump()) for each in table.surfaces]
    if table.room is not None:
        faces = {face.name: face for face in room(table.room.size, table.room.centre)}
        for name in faces if table.room.faces is None else table.room.faces:
            if name not in faces:
                raise RigError(f'[room]: key "faces" names {name!r}; the faces of a room are {", ".join(faces)}')
            surfaces.append(faces[name])
    if not surfaces:
        raise RigError("no place for modules; give a [room] table or [[surfaces]] tables")
    limits = table.limits.model_dump()
    return Space(
        surfaces=tuple(surfaces),
        counts=tuple(table.counts),
        limits=(table.limits.lower, table.limits.upper),
        fixed=tuple(Module(**{**limits, **each.model_dump(exclude_none=True)}) for each in table.modules),
        frames={each.name: _frame(each) for each in table.frames},
    )


def _frame(table: FrameTable) -> Frame:
    if table.rotation is None:
        return Frame(table.position)
    size = {2: 1, 3: 3}.get(len(table.position))
    if len(table.rotation) != size:
        raise RigError(f'frame "{table.name}": key "rotation" must have three numbers in space, one in the plane')
    turn = np.array(table.rotation)
    if not (np.abs(turn) <= MAX_ROTATION_RAD).all():
        raise RigError(
            f'frame "{table.name}": key "rotation" is {brief(table.rotation)}; '
            f"give rad, within {MAX_ROTATION_RAD:g}"
        )
    return Frame(table.position, kinematics.exponential(turn) if size == 3 else turn[0])


def _target(table: SpaceFile) -> Grid:
    target = table.target
    intervals = {"x": target.x, "y": target.y} | ({} if target.z is None else {"z": target.z})
    for key, ends in intervals.items():
        if len(ends) != 2:
            raise RigError(
                f'[target]: key "{key}" has {len(ends)} numbers; give where it starts and where it ends'
            )
    for key, (begin, end) in intervals.items():
        if not max(abs(begin), abs(end)) <= MAX_LENGTH:
            raise RigError(f'[target]: key "{key}" is {begin:g} to {end:g}; give m, within {MAX_LENGTH:g}')
    try:
        grid = box(**{key: tuple(ends) for key, ends in intervals.items()}, step=target.step)
    except ShapeError as error:
        raise RigError(f"[target]: {error}") from None
    if (count := math.prod(grid.shape)) > MAX_POSES:
        raise RigError(f'[target]: key "step" gives {count:,} positions; give one for {MAX_POSES:,} at most')
    return grid
