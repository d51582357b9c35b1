"""Schema of rig files: which keys there are, and of which type.

A new key needs three places: its field here; the field of the same name in `Rig`, `Module` or `Platform`, which
checks its value; and `rig_to_toml` in ``files.py``, which writes it. ``datasets/README.md`` shows every key.
Imported only when a file is read, because pydantic takes its time.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class SchemaTable(BaseModel):
    """Table in which a misspelt key or a number in quotes is an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class LimitsTable(SchemaTable):
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
    friction_coulomb: float | None = Field(None, description="the dry friction of winch and pulley in N, a number")
    friction_viscous: float | None = Field(None, description="their friction per speed in N s/m, a number")
    cable_stiffness: float | None = Field(None, description="the cable's stiffness per strain in N, a number")
    vibration_gain: list[list[float]] | None = Field(
        None, description="rows of frequency in Hz and gain, a list of lists of two numbers"
    )


class ModuleTable(DefaultsTable):
    """One ``[[modules]]`` entry."""

    name: str = Field(min_length=1, description="a name in quotes that no other module has")
    anchor: list[float] = Field(description="where the cable leaves the module, a list of coordinates in m")
    attachment: list[float] | None = Field(
        None, description="where the cable ends in platform axes, a list of coordinates in m"
    )
    frame: str = Field("world", description='"world" or the name of a body frame, in quotes')


class PlatformTable(SchemaTable):
    """The ``[platform]`` table."""

    mass: float = Field(description="the mass in kg, a number")
    com: list[float] | None = Field(None, description="the centre of mass, a list of coordinates in m")
    inertia: list[list[float]] | None = Field(
        None, description="the inertia about the centre of mass in kg·m², a list of rows"
    )


class RequiredTable(SchemaTable):
    """The ``[required]`` table, and a file that holds nothing else."""

    wrench: list[float] | None = Field(None, description="a wrench, a list of numbers in N (and N·m)")
    box: list[float] | None = Field(None, description="half of each edge, a list of numbers in N (and N·m)")
    wrenches: list[list[float]] | None = Field(None, description="a list of wrenches in N (and N·m)")
    ball: float = Field(0.0, description="a radius in N, a number")
    gravity: bool = Field(False, description="true if the cables hold the platform's weight, or false")
    acceleration: float | list[float] | None = Field(
        None, description="half of each edge of a box in m/s² (and rad/s²), or one number for all directions"
    )
    length: float | None = Field(None, description="the characteristic length in m, a number")


class FrameTable(SchemaTable):
    """Entry of ``[[frames]]``: the pose of a body."""

    name: str = Field(min_length=1, description="the name of the body frame in quotes")
    position: list[float] = Field(description="where the body's origin is, a list of coordinates in m")
    rotation: list[float] | None = Field(
        None, description="axis times angle in rad, a list of numbers: three in space, one in the plane"
    )


class BodyTable(SchemaTable):
    """Entry of ``[[bodies]]``: a sphere, capsule or box; or all bodies of a ready person."""

    name: str | None = Field(None, min_length=1, description="a name in quotes that no other body has")
    centre: list[float] | None = Field(None, description="the centre of a sphere or box, in m, a list of numbers")
    start: list[float] | None = Field(None, description="one end of a capsule, a list of coordinates in m")
    end: list[float] | None = Field(None, description="the other end of a capsule, a list of coordinates in m")
    radius: float | None = Field(None, description="the radius of a sphere or capsule in m, a number")
    size: list[float] | None = Field(None, description="the edges of a box, a list of lengths in m")
    frame: str | None = Field(None, description='"world", "hand" or the name of a body frame, in quotes')
    margin: float = Field(0.05, description="the smallest distance to a cable in m, a number")
    sway: float = Field(0.0, description="how far the body may move in any direction in m, a number")
    person: Literal["standing", "seated"] | None = Field(None, description="the posture of a ready person")
    at: list[float] | None = Field(None, description="the floor below a person, a list of coordinates in m")
    facing: list[float] | None = Field(None, description="where a person faces, a list of three numbers")
    height: float | None = Field(None, description="the stature of a person in m, a number")


def _as_list(value: Any) -> Any:
    """Return ``bodies = "standing"`` and ``bodies = {person = "standing"}`` as a list of tables."""
    value = {"person": value} if isinstance(value, str) else value
    return [value] if isinstance(value, dict) else value


Bodies = Annotated[list[BodyTable], BeforeValidator(_as_list)]


class RigFile(SchemaTable):
    """Rig file."""

    name: str = Field(min_length=1, description="a name in quotes")
    kind: str = Field(description='"planar-point", "point", "planar", "platform" or "spherical"')
    home: list[float] = Field(description="the nominal position, a list of coordinates in m")
    home_rotation: list[float] | None = Field(
        None, description="axis times angle at home in rad, a list of numbers"
    )
    description: str = Field("", description="a text in quotes")
    source: str = Field("", description="a text in quotes")
    up: str | None = Field(None, description='the axis that points up, in quotes, as in up = "z"')
    limits: DefaultsTable = Field(DefaultsTable(), description="a [limits] table")
    platform: PlatformTable | None = Field(None, description="a [platform] table")
    required: RequiredTable = Field(RequiredTable(), description="a [required] table")
    frames: list[FrameTable] = Field([], description="[[frames]] tables")
    bodies: Bodies = Field([], description='[[bodies]] tables, "standing" or "seated"')
    modules: list[ModuleTable] = Field(min_length=1, description="at least one [[modules]] table")


class ViaPoint(SchemaTable):
    """Entry of ``[[points]]`` of a trajectory."""

    time_s: float = Field(description="when the platform is there, in s, a number")
    position: list[float] = Field(min_length=2, max_length=3, description="a list of coordinates in m")
    rotation: list[float] | None = Field(None, description="axis times angle in rad, a list of numbers")


class TrajectoryFile(SchemaTable):
    """Trajectory that rests at each of its points."""

    points: list[ViaPoint] = Field(min_length=2, description="at least two [[points]] tables")
    timing: Literal["quintic", "trapezoidal"] = Field("quintic", description='"quintic" or "trapezoidal"')
    step_s: float = Field(0.01, description="the time between samples in s, a number")
