"""How a sweep is labelled: coordinates of configurations, rigs and poses, and attributes of measures."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab import records
from tensionlab.arrays import Floats
from tensionlab.errors import MissingDependency, SweepError
from tensionlab.model import pose
from tensionlab.workspace.base import Measure
from tensionlab.workspace.registry import question
from tensionlab.workspace.sweep.plan import Plan
from tensionlab.workspace.sweep.pose_sets import Coordinate

if TYPE_CHECKING:
    import xarray


def bare_dataset(plan: Plan) -> xarray.Dataset:
    """How will the dataset of a sweep look, before there is a value? Its coordinates and attributes.

    Raises
    ------
    MissingDependency
        If xarray is not installed.
    SweepError, RigError, ShapeError
        As `coordinates`.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingDependency('a sweep needs xarray: pip install "tensionlab[workspace]"') from error
    found = coordinates(plan)
    manifest = records.manifest(sys.orig_argv)
    return xarray.Dataset(
        coords={
            each.name: (each.dims, each.values, {"units": each.units, "long_name": each.long_name})
            for each in found
        },
        attrs={
            "title": f"tensionlab sweep: {', '.join(plan.measures)}",
            "sweep": json.dumps(_identity(plan, found, manifest["versions"]["tensionlab"])),
            "manifest": json.dumps(manifest),
        },
    )


def coordinates(plan: Plan) -> list[Coordinate]:
    """Which labelled coordinates does a sweep have? Every rig is made and checked on the way.

    Raises
    ------
    SweepError, RigError, ShapeError
        If a rig cannot be made or does not suit the poses or the measures, no rig has a body frame that is
        given, or two things have one name.
    """
    found = [*plan.configurations.coordinates(), *_rigs(plan), *plan.poses.coordinates()]
    names = Counter([each.name for each in found] + list(plan.measures))
    if twice := [name for name, count in names.items() if count > 1]:
        raise SweepError(f'two axes or variables of the sweep are called "{twice[0]}"; rename one')
    if slashed := [name for name in names if "/" in name]:
        raise SweepError(f'"{slashed[0]}" has a slash, and cannot name an axis or variable; rename it')
    return found


def attributes(measure: Measure) -> dict[str, str]:
    """Which attributes does the variable of a measure have? ``measure`` is what makes it again."""
    return {
        "units": measure.unit,
        "long_name": measure.title,
        "question": question(measure),
        "measure": repr(measure),
    }


def _rigs(plan: Plan) -> list[Coordinate]:
    """Where the modules of every configuration are and how hard they pull; NaN for modules that it lacks."""
    shape, dims = plan.configurations.shape, plan.configurations.dims
    names, rows, homes = [], [], []
    used: set[str] = set()
    seen: set[tuple[str, int]] = set()
    for index in np.ndindex(*shape):
        rig = plan.configurations.rig(index)
        used.update(rig.frames)
        own = {name: plan.frames[name] for name in rig.frames if name in plan.frames}
        anchors = pose.place_anchors(rig.modules, rig.anchors, own)
        if anchors.ndim > 2:
            raise SweepError("frames: give one pose for each body frame; it is the same all over the sweep")
        if (rig.kind, rig.m) not in seen:
            plan.check(rig)
            seen.add((rig.kind, rig.m))
        homes.append(rig.home)
        names.append((rig.name, rig.kind, rig.up or "", [module.name for module in rig.modules]))
        rows.append((anchors, rig.attachments, rig.limits.lower, rig.limits.upper))
    if unknown := sorted(set(plan.frames) - used):
        raise SweepError(f'frames: no module rides on "{unknown[0]}"; leave it out')

    most = max(len(row[0]) for row in rows)
    anchors, attachments, lower, upper = (_padded([row[i] for row in rows], most, shape) for i in range(4))
    modules = np.array([own + [""] * (most - len(own)) for *_, own in names]).reshape(*shape, most)
    kinds = np.array([kind for _, kind, *_ in names]).reshape(shape)
    ups = np.array([up for _, _, up, _ in names]).reshape(shape)
    axes = "xyz"[: plan.poses.dimension]
    each = (*dims, "module")
    found = [
        Coordinate("kind", dims, kinds, "1", "kind of the rig"),
        Coordinate("up", dims, ups, "1", "axis of the world that points up; empty: not known"),
        Coordinate("module", ("module",), np.arange(most), "1", "number of the module"),
        Coordinate("axis", ("axis",), np.array(list(axes)), "1", "axis of the world or of the platform"),
        Coordinate("home", (*dims, "axis"), np.stack(homes).reshape(*shape, -1), "m", "home position of the rig"),
        Coordinate("module_name", each, modules, "1", "name of the module"),
        Coordinate("anchor", (*each, "axis"), anchors, "m", "anchor of the module in the world"),
        Coordinate("attachment", (*each, "axis"), attachments, "m", "attachment of the cable in platform axes"),
        Coordinate("lower", each, lower, "N", "least tension of the cable"),
        Coordinate("upper", each, upper, "N", "largest tension of the cable"),
    ]
    if "rig" in dims:
        return found
    titles = np.array([name for name, *_ in names]).reshape(shape)
    return [Coordinate("rig", dims, titles, "1", "name of the rig"), *found]


def _padded(rows: list[Floats], length: int, shape: tuple[int, ...]) -> Floats:
    """Rows of different lengths in one array, with NaN behind the shorter ones."""
    table = np.full((len(rows), length, *rows[0].shape[1:]), np.nan)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table.reshape(*shape, *table.shape[1:])


def _identity(plan: Plan, found: Sequence[Coordinate], version: str) -> dict[str, Any]:
    """What makes a sweep this one and no other."""
    of_poses = plan.poses.coordinates()
    names = {each.name for each in of_poses}
    return {
        "rigs": _digest([each for each in found if each.name not in names]),
        "poses": _digest(of_poses),
        "measures": {name: repr(measure) for name, measure in plan.measures.items()},
        "chunks": list(plan.chunks),
        "version": version,
    }


def _digest(found: Sequence[Coordinate]) -> str:
    digest = hashlib.sha256()
    for each in found:
        digest.update(repr((each.name, each.dims, each.values.dtype, each.values.shape)).encode())
        digest.update(np.ascontiguousarray(each.values).tobytes())
    return digest.hexdigest()
