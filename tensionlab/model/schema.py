"""Schema of rig files, and the messages about files that do not follow it.

Types, unknown keys and missing keys are checked here; what the numbers mean is checked by `Rig`, `Module` and
`Platform`, for files and programs alike. Imported only when a file is read, because pydantic takes its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from itertools import accumulate
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from tensionlab.errors import RigError
from tensionlab.support.files.reading import brief


class Table(BaseModel):
    """Table in which a misspelt key or a number in quotes is an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


T = TypeVar("T", bound=Table)
MAX_PROBLEMS_CHARACTERS = 220
"""Of all problems of one file, in a message."""


class LimitsTable(Table):
    """Defaults for every module; a module's own key wins."""

    lower: float | None = Field(None, description="the smallest tension in N, a number")
    upper: float | None = Field(None, description="the largest tension in N, a number")
    brake: float | None = Field(None, description="the largest tension that the brake holds in N, a number")
    newton_per_ampere: float | None = Field(None, description="the tension per motor current in N/A, a number")
    spool_radius: float | None = Field(None, description="the radius of the spool in m, a number")


class DefaultsTable(LimitsTable):
    """Defaults for every module of a rig."""

    pulley_radius: float | None = Field(None, description="the radius of the pulley in m, a number")
    pulley_axis: list[float] | None = Field(
        None, description="the direction in which the cable comes to the pulley, a list of numbers"
    )


class ModuleTable(DefaultsTable):
    """One ``[[modules]]`` entry."""

    name: str = Field(min_length=1, description="a name in quotes that no other module has")
    anchor: list[float] = Field(description="where the cable leaves the module, a list of coordinates in m")
    attachment: list[float] | None = Field(
        None, description="where the cable ends in platform axes, a list of coordinates in m"
    )
    frame: str = Field("world", description='"world" or the name of a body frame, in quotes')


class PlatformTable(Table):
    """The ``[platform]`` table."""

    mass: float = Field(description="the mass in kg, a number")
    com: list[float] | None = Field(None, description="the centre of mass, a list of coordinates in m")
    inertia: list[list[float]] | None = Field(
        None, description="the inertia about the centre of mass in kg·m², a list of rows"
    )


class RequiredTable(Table):
    """The ``[required]`` table, and a file that holds nothing else."""

    wrench: list[float] | None = Field(None, description="a wrench, a list of numbers in N (and N·m)")
    box: list[float] | None = Field(None, description="half of each edge, a list of numbers in N (and N·m)")
    wrenches: list[list[float]] | None = Field(None, description="a list of wrenches in N (and N·m)")
    ball: float = Field(0.0, description="a radius in N, a number")
    gravity: bool = Field(False, description="true if the cables hold the platform's weight, or false")
    length: float | None = Field(None, description="the characteristic length in m, a number")


class FrameTable(Table):
    """Entry of ``[[frames]]``: the pose of a body."""

    name: str = Field(min_length=1, description="the name of the body frame in quotes")
    position: list[float] = Field(description="where the body's origin is, a list of coordinates in m")
    rotation: list[float] | None = Field(
        None, description="axis times angle in rad, a list of numbers: three in space, one in the plane"
    )


class RigFile(Table):
    """Rig file."""

    name: str = Field(min_length=1, description="a name in quotes")
    kind: str = Field(description='"planar-point", "point", "planar" or "platform"')
    home: list[float] = Field(description="the nominal position, a list of coordinates in m")
    description: str = Field("", description="a text in quotes")
    source: str = Field("", description="a text in quotes")
    up: str | None = Field(None, description='the axis that points up, in quotes, as in up = "z"')
    limits: DefaultsTable = Field(DefaultsTable(), description="a [limits] table")
    platform: PlatformTable | None = Field(None, description="a [platform] table")
    required: RequiredTable = Field(RequiredTable(), description="a [required] table")
    frames: list[FrameTable] = Field([], description="[[frames]] tables")
    modules: list[ModuleTable] = Field(min_length=1, description="at least one [[modules]] table")


def check(kind: type[T], document: dict[str, Any]) -> T:
    """Check the contents of a file of some kind.

    RigError has one line a problem, each naming the table, such as the module, and the key, and saying what to do.
    """
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        raise RigError(_together([_explain(problem, kind, document) for problem in error.errors()])) from None


def _together(lines: list[str]) -> str:
    """Return all problems in one message: without advice where that is too long, and then as many as fit."""
    if len(lines) == 1:
        return lines[0]
    count = len(lines)
    if sum(map(len, lines)) > MAX_PROBLEMS_CHARACTERS:
        lines = [line.partition("; ")[0] for line in lines]
        fitting = sum(length <= MAX_PROBLEMS_CHARACTERS for length in accumulate(map(len, lines)))
        lines = lines[: max(fitting, 1)]
    more = [f"and {count - len(lines)} more"] if len(lines) < count else []
    return "\n  ".join([f"{count} problems:", *lines, *more])


def _explain(problem: ErrorDetails, kind: type[Table], document: dict[str, Any]) -> str:
    """Say in one line where a problem is, what is wrong, and what to do."""
    *path, last = problem["loc"]
    table, where = _locate(path, kind, document)
    if problem["type"] == "extra_forbidden":
        close = get_close_matches(str(last), table.model_fields, n=1)
        remedy = f'did you mean "{close[0]}"?' if close else f"the keys here are {', '.join(table.model_fields)}"
        return f'{where}unknown key "{last!s:.40}"; {remedy}'
    # Inside a list the key is further up, and the last step is the number of the entry.
    keys = [str(step) for step in problem["loc"] if step in table.model_fields]
    if not keys:
        return f"{where}is {brief(problem['input'])}; write it as a table of keys and values"
    give = f"give {table.model_fields[keys[-1]].description}"
    if problem["type"] == "missing":
        return f'{where}key "{keys[-1]}" is missing; {give}'
    entry = f", entry {last + 1}," if isinstance(last, int) else ""
    return f'{where}key "{keys[-1]}"{entry} is {brief(problem["input"])}; {give}'


def _locate(path: Sequence[str | int], kind: type[Table], document: dict[str, Any]) -> tuple[type[Table], str]:
    """Find the table that a path leads into, and how to call it: [limits], or module 2 ("top")."""
    match path:
        case [str(key), int(index), *_] if inner := _table_in(kind, key):
            entry = document[key][index]
            name = entry.get("name") if isinstance(entry, dict) else None
            singular = key.removesuffix("s")
            return inner, f'{singular} {index + 1} ("{name!s:.40}"): ' if name else f"{singular} {index + 1}: "
        case [str(key), *_] if isinstance(document[key], dict) and (inner := _table_in(kind, key)):
            return inner, f"[{key}]: "
    return kind, ""


def _table_in(kind: type[Table], key: str) -> type[Table] | None:
    """Return the kind of table that a key holds, alone or in a list; None if it holds no table."""
    if key not in kind.model_fields:
        return None
    annotation = kind.model_fields[key].annotation
    inside = [annotation, *get_args(annotation)]
    return next((each for each in inside if isinstance(each, type) and issubclass(each, Table)), None)
