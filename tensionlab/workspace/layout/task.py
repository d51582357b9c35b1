"""Search tasks from TOML files: `load_task`, and what a file may hold; `Space` checks what the numbers mean."""

from __future__ import annotations

import math
from os import PathLike
from typing import Annotated, Literal, NamedTuple, get_args

from pydantic import Field, PositiveFloat

from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.model import schema
from tensionlab.model.files import requirement
from tensionlab.model.module import MAX_LENGTH, Module, Platform
from tensionlab.model.pose import RestPose
from tensionlab.model.schema import FrameTable, ModuleTable, PlatformTable, RequiredTable, SchemaTable
from tensionlab.support.files.named import find
from tensionlab.support.files.reading import brief, read_toml
from tensionlab.support.validation import validate
from tensionlab.workspace.layout.results import LayoutSearch, Objective
from tensionlab.workspace.layout.search import Progress, search_layout
from tensionlab.workspace.layout.space import Hardware, Space, Surface, room
from tensionlab.workspace.poses import Grid, box

ROOM_UP = "y"  # axis of `room` that points up
MAX_POSES = 1_000_000  # largest number of positions of a target; a search evaluates each thousands of times


Coordinate = Annotated[float, Field(ge=-MAX_LENGTH, le=MAX_LENGTH)]
Interval = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Face = Literal["left wall", "right wall", "floor", "ceiling", "back wall", "front wall"]


class RoomTable(SchemaTable):
    """Table ``[room]``: surfaces that need not be written one by one."""

    size: Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)] = Field(
        description="width along X, height along Y and depth along Z, in m"
    )
    centre: list[float] | None = Field(None, description="the middle of the room, a list of coordinates in m")
    faces: list[Face] | None = Field(None, description="names of the faces to use; all are used if left out")


class SurfaceTable(SchemaTable):
    """Entry of ``[[surfaces]]``."""

    name: str = Field(min_length=1, description="a name in quotes that no other surface has")
    corner: list[float] = Field(description="where all edges start, a list of coordinates in m")
    edges: list[list[float]] = Field(description="one to three edges, a list of lists of coordinates in m")
    frame: str = Field("world", description='"world" or the name of a body frame, in quotes')


class SearchLimits(schema.LimitsTable):
    """Table ``[limits]``: limits of the modules that are placed, and defaults of those that stay."""

    lower: float = Field(description="the smallest tension in N, a number")
    upper: float = Field(description="the largest tension in N, a number")


class TargetTable(SchemaTable):
    """Table ``[target]``."""

    x: Interval = Field(description="start and end along X, in m")
    y: Interval = Field(description="start and end along Y, in m")
    z: Interval | None = Field(None, description="start and end along Z, in m")
    step: float = Field(description="the distance of neighbouring positions in m, a number")


class ObjectiveTable(SchemaTable):
    """Table ``[objective]``."""

    force: float | None = Field(None, description="the force in N to be had in every direction, a number")


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
    target: TargetTable = Field(description="a [target] table")
    platform: PlatformTable | None = Field(None, description="a [platform] table")
    required: RequiredTable = Field(RequiredTable(), description="a [required] table")
    objective: ObjectiveTable = Field(ObjectiveTable(), description="an [objective] table")
    search: SearchTable = Field(SearchTable(), description="a [search] table")
    room: RoomTable | None = Field(None, description="a [room] table")
    surfaces: list[SurfaceTable] = Field([], description="[[surfaces]] tables")
    modules: list[ModuleTable] = Field([], description="[[modules]] tables")
    frames: list[FrameTable] = Field([], description="[[frames]] tables")


class LayoutTask(NamedTuple):
    """Arguments of `search_layout`, as a file gives them."""

    name: str
    space: Space
    target: Grid
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
        target = box(**table.target.model_dump())
        if (count := math.prod(target.shape)) > MAX_POSES:
            raise RigError(f'[target]: key "step" gives {count:,} positions; give one for {MAX_POSES:,} at most')
        return LayoutTask(
            name=table.name,
            space=_space(table),
            target=target,
            objective=Objective(table.objective.force),
            **table.search.model_dump(),
        )
    except (RigError, ShapeError, InputError) as error:
        raise RigError(f"{path}: {error}") from None


def _space(table: SpaceFile) -> Space:
    surfaces = [Surface(**each.model_dump()) for each in table.surfaces]
    if table.room is not None:
        faces = {face.name: face for face in room(table.room.size, table.room.centre)}
        surfaces += [faces[name] for name in (faces if table.room.faces is None else table.room.faces)]
    if not surfaces:
        raise RigError("no place for modules; give a [room] table or [[surfaces]] tables")
    if table.room is not None and table.up not in (None, ROOM_UP):
        raise RigError(f'key "up" is {brief(table.up)}; a [room] has Y up, so leave it out, or write [[surfaces]]')
    limits = table.limits.model_dump(exclude_none=True)
    return Space(
        surfaces=tuple(surfaces),
        counts=tuple(table.counts),
        limits=(table.limits.lower, table.limits.upper),
        fixed=tuple(Module(**{**limits, **each.model_dump(exclude_none=True)}) for each in table.modules),
        rest=tuple(RestPose(**each.model_dump()) for each in table.frames),
        hardware={key: limits[key] for key in get_args(Hardware) if key in limits},
        up=table.up if table.room is None else ROOM_UP,
        platform=None if table.platform is None else Platform(**table.platform.model_dump()),
        required=requirement(table.required.model_dump(), "[required]: "),
    )
