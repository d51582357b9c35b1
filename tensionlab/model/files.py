"""Rigs as TOML files: `load_rig` and `save_rig`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import RigError
from tensionlab.model.bodies import Body, person
from tensionlab.model.module import KINDS, WORLD, Module, Platform
from tensionlab.model.pose import RestPose
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.support.files.named import find
from tensionlab.support.files.reading import parse_toml, read_text, read_toml

if TYPE_CHECKING:
    from tensionlab.model.schema import BodyTable

# Keys of a module that the table `[limits]` can give for all.
SHARED = ("lower", "upper", "brake", "newton_per_ampere", "spool_radius", "pulley_radius", "pulley_axis",
          "friction_coulomb", "friction_viscous", "cable_stiffness", "vibration_gain")  # fmt: skip
BODY_KEYS = ("name", "centre", "start", "end", "radius", "size", "frame", "margin", "sway")
PERSON_KEYS = ("at", "facing", "height", "margin", "sway")


def load_rig(path: str | PathLike[str]) -> Rig:
    """Read a rig that comes with this package, by its name, or a rig file, by its path.

    A path ends in ``.toml`` or has a separator. Another text is a name: ``tl.datasets.names("rigs")`` lists them,
    with their folder. ``datasets/README.md`` shows the format of the file, with every key. RigError names the
    file, the module and the key, and says what to do.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.load_rig("ipanema-2").m
    8
    """
    path = find(path, "rigs", RigError)
    return rig_from_toml(read_text(path, "a rig file (*.toml)", RigError), source=str(path))


def save_rig(rig: Rig, path: str | PathLike[str]) -> None:
    """Write a rig to a TOML file from which `load_rig` makes the very same rig; comments are not kept.

    An existing file at ``path`` is replaced. WriteError if it cannot be written.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> tl.save_rig(rig, "copy.toml")
    >>> tl.load_rig("copy.toml").name
    'bartels2026-validation'
    """
    writing.write_text(path, rig_to_toml(rig))


def rig_from_toml(text: str, source: str) -> Rig:
    """Read a rig from a TOML text, which errors call ``source``."""
    from tensionlab.model import schema
    from tensionlab.support.validation import validate

    document = parse_toml(text, source, RigError)
    try:
        table = validate(schema.RigFile, document, RigError)
        shared = table.limits.model_dump(exclude_none=True)
        modules = []
        for number, own in enumerate(table.modules, start=1):
            keys = {**shared, **own.model_dump(exclude_none=True)}
            needed = ["lower", "upper"]
            if table.kind in KINDS and KINDS[table.kind].has_orientation:
                needed.append("attachment")
            for key in needed:
                if key not in keys:
                    elsewhere = "" if key == "attachment" else ", or a default in the table [limits]"
                    give = schema.ModuleTable.model_fields[key].description
                    here = f'module {number} ("{own.name:.40}")'
                    raise RigError(f'{here}: key "{key}" is missing; give {give}{elsewhere}')
            modules.append(Module(**keys))
        platform = None if table.platform is None else Platform(**table.platform.model_dump())
        required = requirement(table.required.model_dump(), "[required]: ")
        bodies, poses = bodies_of(table.bodies, table.up)
        rest = (*(RestPose(**frame.model_dump()) for frame in table.frames), *poses)
        others = table.model_dump(exclude={"modules", "limits", "platform", "required", "frames", "bodies"})
        return Rig(
            modules=tuple(modules), platform=platform, required=required, rest=rest, bodies=bodies, **others
        )
    except RigError as error:
        raise RigError(f"{source}: {error}") from None


def bodies_of(tables: Sequence[BodyTable], up: str | None) -> tuple[tuple[Body, ...], tuple[RestPose, ...]]:
    """Return the bodies that a file lists, and the poses of the frames of persons; RigError names the body."""
    bodies: list[Body] = []
    poses: list[RestPose] = []
    for table in tables:
        keys = table.model_dump(exclude_none=True)
        posture, name = keys.pop("person", None), keys.get("name", "")
        here, known = (f'body "{name}"', BODY_KEYS) if posture is None else (f'person = "{posture}"', PERSON_KEYS)
        if wrong := [key for key in keys if key not in known]:
            raise RigError(f'{here}: key "{wrong[0]}" does not belong to it; the keys are {", ".join(known)}')
        if posture is None:
            if ("centre" in keys) == ("end" in keys) or ("start" in keys) != ("end" in keys):
                raise RigError(f'{here}: give "centre" for a sphere or box, "start" and "end" for a capsule')
            bodies.append(Body(**{"name": name, "start": keys.pop("centre", None)} | keys))
        elif up is None:
            raise RigError('key "up" is missing; a person needs the axis that points up, as in up = "z"')
        else:
            parts, pose_at_rest = person(posture, up, **keys)
            bodies += parts
            poses.append(pose_at_rest)
    return tuple(bodies), tuple(poses)


def load_requirement(path: str | PathLike[str]) -> Requirement:
    r"""Read a file of required wrenches: the keys of the table ``[required]`` of a rig file, and nothing else.

    ``path`` is that of the TOML file. RigError names the file and the key.

    Examples
    --------
    >>> import pathlib
    >>> import tensionlab as tl
    >>> _ = pathlib.Path("pushes.toml").write_text("gravity = true\nbox = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]\n")
    >>> tl.load_requirement("pushes.toml").at(tl.load_rig("cogiro")).shape
    (64, 6)
    """
    from tensionlab.model import schema
    from tensionlab.support.validation import validate

    document = read_toml(path, "a file of required wrenches (*.toml)", RigError)
    try:
        return requirement(validate(schema.RequiredTable, document, RigError).model_dump())
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def requirement(keys: dict[str, Any], where: str = "") -> Requirement:
    """Return the requirement of a table's keys; an error begins with where the table is."""
    try:
        return Requirement(**keys)
    except RigError as error:
        raise RigError(f"{where}{error}") from None


def rig_to_toml(rig: Rig) -> str:
    """Return a rig in TOML. Values that all modules share go into ``[limits]``."""
    import tomli_w

    document: dict[str, Any] = {"name": rig.name, "kind": rig.kind}
    for key in ("up", "description", "source"):
        if getattr(rig, key):
            document[key] = getattr(rig, key)
    document |= _given(rig, ["home", "home_rotation"])
    first, *others = rig.modules
    common = [
        key
        for key in SHARED
        if all(np.array_equal(getattr(module, key), getattr(first, key)) for module in others)
    ]
    document["limits"] = _given(first, common)
    if rig.platform is not None:
        document["platform"] = _given(rig.platform, ["mass", "com", "inertia"])
    if rig.required != Requirement():
        document["required"] = _given(rig.required, ["wrench", "box", "wrenches", "acceleration", "length"])
        document["required"] |= {"ball": rig.required.ball} if rig.required.ball else {}
        document["required"] |= {"gravity": True} if rig.required.gravity else {}
    if rig.rest:
        document["frames"] = [{"name": pose.name} | _given(pose, ["position", "rotation"]) for pose in rig.rest]
    if rig.bodies:
        document["bodies"] = [
            {"name": body.name, "frame": body.frame, "margin": body.margin, "sway": body.sway}
            | {"centre" if body.end is None else "start": body.start.tolist()}
            | _given(body, ["end", "size"])
            | ({"radius": body.radius} if body.size is None else {})
            for body in rig.bodies
        ]
    own = ["attachment"] if KINDS[rig.kind].has_orientation else []
    own += [key for key in SHARED if key not in common]
    document["modules"] = [
        {"name": module.name, "anchor": module.anchor.tolist()}
        | ({} if module.frame == WORLD else {"frame": module.frame})
        | _given(module, own)
        for module in rig.modules
    ]
    # tomli-w puts every number of a list on a line of its own; a point reads better on one. No text can look
    # like this, because line ends inside texts are written as \n.
    one_line = re.compile(r"\[\n\s+([-+.\w]+(?:,\n\s+[-+.\w]+)*),\n\s*\]")
    return one_line.sub(
        lambda match: "[" + ", ".join(number.strip() for number in match[1].split(",\n")) + "]",
        tomli_w.dumps(document),
    )


def _given(record: Body | Module | Platform | Requirement | RestPose | Rig, keys: Sequence[str]) -> dict[str, Any]:
    """Return those of the values that are known, as TOML has them."""
    values = {key: getattr(record, key) for key in keys}
    return {key: np.asarray(value, np.float64).tolist() for key, value in values.items() if value is not None}
