"""Search tasks from TOML files: `load_task`, and what a file may hold; `Space` checks what the numbers mean."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from pydantic import Field, PositiveFloat

from tensionlab.errors import DataError, InputError, RigError, ShapeError
from tensionlab.model import schema
from tensionlab.model.files import bodies_of, requirement
from tensionlab.model.module import MAX_LENGTH, Module, Platform, upward
from tensionlab.model.pose import RestPose
from tensionlab.model.schema import Bodies, FrameTable, ModuleTable, PlatformTable, RequiredTable, SchemaTable
from tensionlab.support.files.named import find
from tensionlab.support.files.reading import brief, read_toml
from tensionlab.support.validation import validate
from tensionlab.workspace.layout.objective import Objective, Target
from tensionlab.workspace.layout.results import LayoutSearch
from tensionlab.workspace.layout.search import Progress, search_layout
from tensionlab.workspace.layout.space import Hardware, Space, Surface, room
from tensionlab.workspace.orientations import parse_rotations
from tensionlab.workspace.poses import box, read_poses

ROOM_UP = "y"  # axis of `room` that points up
MAX_POSES = 1_000_000  # largest number of positions of a target; a search evaluates each thousands of times


Coordinate = Annotated[float, Field(ge=-MAX_LENGTH, le=MAX_LENGTH)]
Interval = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Direction = str | list[float]
DIRECTIONS = 'words such as "up", "down", "+x", "-z", or of vectors'
Face = Literal["left wall", "right wall", "floor", "ceiling", "back wall", "front wall"]


class RoomTable(SchemaTable):
    """Table ``[room]``: surfaces that need not be written one by one."""

    size: Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)] = Field(
        description="width along X, height along Y and depth along Z, in m"
    )
    centre: list[float] | None = Field(None, description="the middle of the room, a list of coordinates in m")
    faces: list[Face] | None = Field(None, description="names of the faces to use; all are used if left out")


class AttachmentTable(SchemaTable):
    """Entry of ``[[attachments]]``: where cables may end on a platform."""

    name: str = Field(min_length=1, description="a name in quotes that no other surface has")
    corner: list[float] = Field(description="where all edges start, a list of coordinates in m")
    edges: list[list[float]] = Field([], description="up to three edges, a list of lists of coordinates in m")


class SurfaceTable(AttachmentTable):
    """Entry of ``[[surfaces]]``."""

    frame: str = Field("world", description='"world" or the name of a body frame, in quotes')


class SearchLimits(schema.LimitsTable):
    """Table ``[limits]``: limits of the modules that are placed, and defaults of those that stay."""

    lower: float = Field(description="the smallest tension in N, a number")
    upper: float = Field(description="the largest tension in N, a number")


class TargetTable(SchemaTable):
    """Table ``[target]`` or entry of ``[[targets]]``: a box with a step, or the path of a hand."""

    x: Interval | None = Field(None, description="start and end along X, in m")
    y: Interval | None = Field(None, description="start and end along Y, in m")
    z: Interval | None = Field(None, description="start and end along Z, in m")
    step: float | None = Field(None, description="the distance of neighbouring positions in m, a number")
    rotations: str | None = Field(None, description='orientations of a platform in quotes, as in "cone:10"')
    path: str | None = Field(None, description="a CSV file with columns x, y, z in m, in quotes")

    def poses(self, folder: Path, space: Space) -> Target:
        """Return the poses of the hand; RigError for neither a whole box nor a path, and for too many."""
        keys = self.model_dump(exclude={"path"}, exclude_none=True)
        if self.rotations is not None:
            axis = np.eye(space.dimension)[-1] if space.up is None else upward(space.up, space.dimension)
            keys["rotations"] = parse_rotations(self.rotations, space.dimension, axis)
        if self.path is not None and not keys:
            return read_poses(folder / self.path)
        if missing := [key for key in ("x", "y", "step") if key not in keys or self.path is not None]:
            raise RigError(f'[target]: key "{missing[0]}" is missing, or there with a path; give one')
        grid = box(**keys)
        if (count := math.prod(grid.shape)) > MAX_POSES:
            raise RigError(f'[target]: key "step" gives {count:,} positions; give one for {MAX_POSES:,} at most')
        return grid


class ObjectiveTable(SchemaTable):
    """Table ``[objective]``."""

    force: float | None = Field(None, description="the desired force in N, a number")
    directions: list[Direction] | None = Field(None, description=f"where the force pulls, a list of {DIRECTIONS}")
    stiffness: float | None = Field(None, description="the desired stiffness of walls in N/m, a number")
    walls: list[Direction] | None = Field(None, description=f"where walls push the hand, a list of {DIRECTIONS}")
    losses: Literal[0, 1] = Field(0, description="1 to count the loss of any one cable, a whole number")


class SearchTable(SchemaTable):
    """Table ``[search]``."""

    seed: int = Field(0, ge=0, description="a whole number, 0 or more")
    generations: int = Field(30, ge=1, description="how long to evolve, a whole number above zero")
    starts: int = Field(50, ge=1, description="how many layouts to polish, a whole number above zero")


class SpaceFile(SchemaTable):
    """Whole file."""

    name: str = Field(min_length=1, description="a name in quotes")
    description: str = Field("", description="a text in quotes")
    up: str | None = Field(None, description='the axis that points up, in quotes, as in up = "z"')
    counts: list[int] = Field(min_length=1, description="how many modules to place, a list of whole numbers")
    limits: SearchLimits = Field(description="a [limits] table")
    target: TargetTable | None = Field(None, description="a [target] table")
    targets: list[TargetTable] = Field([], description="[[targets]] tables")
    platform: PlatformTable | None = Field(None, description="a [platform] table")
    required: RequiredTable = Field(RequiredTable(), description="a [required] table")
    objective: ObjectiveTable = Field(ObjectiveTable(), description="an [objective] table")
    search: SearchTable = Field(SearchTable(), description="a [search] table")
    room: RoomTable | None = Field(None, description="a [room] table")
    surfaces: list[SurfaceTable] = Field([], description="[[surfaces]] tables")
    attachments: list[AttachmentTable] = Field([], description="[[attachments]] tables")
    symmetry: list[str] = Field([], description='axes and turns in quotes, as in ["x", "3-fold"]')
    modules: list[ModuleTable] = Field([], description="[[modules]] tables")
    frames: list[FrameTable] = Field([], description="[[frames]] tables")
    bodies: Bodies = Field([], description='[[bodies]] tables, "standing" or "seated"')


class LayoutTask(NamedTuple):
    """Arguments of `search_layout`, as a file gives them."""

    name: str
    space: Space
    target: tuple[Target, ...]
    objective: Objective
    seed: int
    generations: int
    starts: int

    def run(self, *, certify: bool = False, progress: Progress | None = None) -> LayoutSearch:
        """Search; parameters and errors as in `search_layout`."""
        return search_layout(**self._asdict(), certify=certify, progress=progress)


def load_task(path: str | PathLike[str]) -> LayoutTask:
    """Return the search task of a space of this package, by name, or of a space file, by path, as in `load_rig`.

    ``datasets/README.md`` shows the format of the file. RigError names the file, the table and the key.
    """
    path = find(path, "spaces", RigError)
    document = read_toml(path, "a space file (*.toml)", RigError)
    try:
        table = validate(SpaceFile, document, RigError)
        space, targets = _space(table), [*([table.target] if table.target else []), *table.targets]
        if not targets:
            raise RigError("no target; give a [target] table, or [[targets]] tables")
        return LayoutTask(
            name=table.name,
            space=space,
            target=tuple(target.poses(Path(path).parent, space) for target in targets),
            objective=_objective(table.objective, space),
            **table.search.model_dump(),
        )
    except (RigError, DataError, ShapeError, InputError) as error:
        raise RigError(f"{path}: {error}") from None


def _objective(wanted: ObjectiveTable, space: Space) -> Objective:
    """Return the objective, whose directions may be words."""
    d = space.dimension
    words = {f"{sign}{axis}": upward(f"{sign}{axis}", d).tolist() for sign in ("", "+", "-") for axis in "xyz"[:d]}
    if space.up is not None:
        words |= {"up": upward(space.up, d).tolist(), "down": (-upward(space.up, d)).tolist()}

    def vectors(key: str) -> list[list[float]] | None:
        values = getattr(wanted, key)
        parsed = [words.get(value, []) if isinstance(value, str) else value for value in values or ()]
        for value, vector in zip(values or (), parsed, strict=True):
            if len(vector) != d:
                up = "" if space.up else ', and up = "z" or another axis'
                raise RigError(f'[objective]: key "{key}": {brief(value)}; give {DIRECTIONS} of {d} numbers{up}')
        return parsed or None

    return Objective(wanted.force, vectors("directions"), wanted.stiffness, vectors("walls"), wanted.losses)


def _space(table: SpaceFile) -> Space:
    surfaces = [Surface(**surface.model_dump()) for surface in table.surfaces]
    if table.room is not None:
        faces = {face.name: face for face in room(table.room.size, table.room.centre)}
        surfaces += [faces[name] for name in (faces if table.room.faces is None else table.room.faces)]
    if not surfaces:
        raise RigError("no place for modules; give a [room] table or [[surfaces]] tables")
    if table.room is not None and table.up not in (None, ROOM_UP):
        raise RigError(f'key "up" is {brief(table.up)}; a [room] has Y up, so leave it out, or write [[surfaces]]')
    limits, up = table.limits.model_dump(exclude_none=True), table.up if table.room is None else ROOM_UP
    bodies, persons = bodies_of(table.bodies, up)
    return Space(
        surfaces=tuple(surfaces),
        counts=tuple(table.counts),
        limits=(table.limits.lower, table.limits.upper),
        fixed=tuple(Module(**{**limits, **module.model_dump(exclude_none=True)}) for module in table.modules),
        rest=(*(RestPose(**frame.model_dump()) for frame in table.frames), *persons),
        bodies=bodies,
        hardware={key: limits[key] for key in get_args(Hardware) if key in limits},
        up=up,
        platform=None if table.platform is None else Platform(**table.platform.model_dump()),
        required=requirement(table.required.model_dump(), "[required]: "),
        attachments=tuple(Surface(**surface.model_dump()) for surface in table.attachments),
        symmetry=tuple(table.symmetry),
    )
