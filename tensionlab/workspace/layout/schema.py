"""What a file that asks for a layout may hold, as pydantic sees it; `Space` checks what the numbers mean."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from tensionlab.model.schema import ModuleTable, Table, check


class RoomTable(Table):
    """The ``[room]`` table: surfaces that need not be written one by one."""

    size: list[float] = Field(
        description="width along X, height along Y and depth along Z, a list of lengths in m"
    )
    centre: list[float] | None = Field(None, description="the middle of the room, a list of coordinates in m")
    faces: list[str] | None = Field(None, description="the names of the faces to use, a list of texts in quotes")


class SurfaceTable(Table):
    """One ``[[surfaces]]`` entry."""

    name: str = Field(min_length=1, description="a name in quotes that no other surface has")
    corner: list[float] = Field(description="where all edges start, a list of coordinates in m")
    edges: list[list[float]] = Field(description="one to three edges, a list of lists of coordinates in m")
    frame: str = Field("world", description='"world" or the name of a body frame, in quotes')


class FrameTable(Table):
    """One ``[[frames]]`` entry: where a body is."""

    name: str = Field(min_length=1, description="the name of the body frame in quotes")
    position: list[float] = Field(description="where the body's origin is, a list of coordinates in m")
    rotation: list[float] | None = Field(
        None, description="axis times angle in rad, a list of numbers: three in space, one in the plane"
    )


class LimitsTable(Table):
    """The ``[limits]`` table."""

    lower: float = Field(description="the smallest tension in N, a number")
    upper: float = Field(description="the largest tension in N, a number")


class TargetTable(Table):
    """The ``[target]`` table."""

    x: list[float] = Field(description="from where to where along X, a list of two coordinates in m")
    y: list[float] = Field(description="from where to where along Y, a list of two coordinates in m")
    z: list[float] | None = Field(None, description="from where to where along Z, a list of two coordinates in m")
    step: float = Field(description="the distance of neighbouring positions in m, a number")


class ObjectiveTable(Table):
    """The ``[objective]`` table."""

    force: float | None = Field(None, description="the force in N to be had in every direction, a number")


class SearchTable(Table):
    """The ``[search]`` table."""

    seed: int = Field(0, ge=0, description="a whole number, 0 or more")
    generations: int = Field(30, ge=1, description="how long to evolve, a whole number above zero")
    starts: int = Field(50, ge=1, description="how many layouts to polish, a whole number above zero")


class SpaceFile(Table):
    """A whole file."""

    name: str = Field(min_length=1, description="a name in quotes")
    description: str = Field("", description="a text in quotes")
    counts: list[int] = Field(min_length=1, description="how many modules to put, a list of whole numbers")
    limits: LimitsTable = Field(description="a [limits] table")
    target: TargetTable = Field(description="a [target] table")
    objective: ObjectiveTable = Field(ObjectiveTable(), description="an [objective] table")
    search: SearchTable = Field(SearchTable(), description="a [search] table")
    room: RoomTable | None = Field(None, description="a [room] table")
    surfaces: list[SurfaceTable] = Field([], description="[[surfaces]] tables")
    modules: list[ModuleTable] = Field([], description="[[modules]] tables")
    frames: list[FrameTable] = Field([], description="[[frames]] tables")


def parse(document: dict[str, Any]) -> SpaceFile:
    """Check the contents of a file.

    Raises
    ------
    RigError
        One line a problem, each naming the table and the key, and saying what to do.
    """
    return check(SpaceFile, document)
