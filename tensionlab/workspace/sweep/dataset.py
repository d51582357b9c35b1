"""Dataset of a sweep: coordinates of configurations, rigs and poses, attributes of metrics."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model import pose
from tensionlab.model.rig import Rig
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.workspace.metrics import Metric
from tensionlab.workspace.poses import Label, label
from tensionlab.workspace.sweep.plan import Plan

if TYPE_CHECKING:
    import xarray


def empty_dataset(plan: Plan) -> xarray.Dataset:
    """Return the dataset of a sweep without values: its coordinates and attributes.

    Every rig is made on the way, and refused if it does not suit the poses or the metrics, or lacks a body frame.
    """
    rigs = list(plan.configurations.rigs())
    if unknown := sorted(set(plan.frames) - {name for rig in rigs for name in rig.frames}):
        raise SweepError(f'frames: no module is attached to "{unknown[0]}"; leave it out')
    for rig in rigs:
        plan.check_dimension(rig)
    axes, poses, of_rigs = plan.configurations.labels(), plan.poses.labels(), _rig_labels(plan, rigs)
    for rig in {(rig.kind, rig.m): rig for rig in reversed(rigs)}.values():
        plan.check(rig)
    demands = {name: of_rigs.pop(name) for name in ("required", "characteristic_length")}
    if "rig" in axes:
        del of_rigs["rig"]
    names = Counter(chain(axes, of_rigs, demands, poses, (each.name for each in plan.metrics)))
    if twice := [name for name, count in names.items() if count > 1]:
        raise SweepError(f'two axes or variables of the sweep are called "{twice[0]}"; rename or leave out one')
    if slashed := [name for name in names if "/" in name]:
        raise SweepError(f'"{slashed[0]}" has a slash, and cannot name an axis or variable; rename it')
    manifest = provenance.manifest(sys.orig_argv)
    identity = {
        "rigs": _digest(axes | of_rigs),
        "poses": _digest(poses),
        "required": _digest(demands, [repr(plan.requirement(rig)) for rig in rigs]),
        "metrics": {each.name: each.identity for each in plan.metrics},
        "chunks": list(plan.chunks),
        "version": manifest["versions"]["tensionlab"],
    }
    attrs = {
        "title": f"tensionlab sweep: {', '.join(each.name for each in plan.metrics)}",
        "sweep": json.dumps(identity),
        "manifest": json.dumps(manifest),
    }
    coordinates = {**axes, **of_rigs, **demands, **poses}
    empty: xarray.Dataset = provenance.import_xarray().Dataset(coords=coordinates, attrs=attrs)
    return empty


def attributes(metric: Metric) -> dict[str, str]:
    """Return the attributes of a metric's variable."""
    return {
        "units": metric.unit,
        "long_name": metric.title or metric.name,
        "description": metric.description,
        "better": metric.direction,
    }


def _rig_labels(plan: Plan, rigs: Sequence[Rig]) -> dict[str, Label]:
    """Return the labels of the rig of every configuration; NaN or "" for modules that a rig lacks."""
    shape, dims = plan.configurations.shape, plan.configurations.dims
    most, axes = max(rig.m for rig in rigs), list("xyz"[: plan.poses.dimension])

    def anchors(rig: Rig) -> Floats:
        placed = pose.place_anchors(rig.modules, rig.anchors, plan.own_frames(rig))
        if placed.ndim > 2:
            raise SweepError("frames: give one pose for each body frame; it is the same all over the sweep")
        return placed

    def of_rig(value: Callable[[Rig], Any], units: str, meaning: str) -> Label:
        return label(dims, np.reshape([value(rig) for rig in rigs], shape), units, meaning)

    def of_modules(value: Callable[[Rig], Any], units: str, meaning: str, *more: str) -> Label:
        rows = [np.asarray(value(rig)) for rig in rigs]
        dtype = np.result_type(*rows)
        table = np.full((len(rigs), most, *rows[0].shape[1:]), "" if dtype.kind == "U" else np.nan, dtype)
        for padded, row in zip(table, rows, strict=True):
            padded[: len(row)] = row
        return label((*dims, "module", *more), table.reshape(*shape, *table.shape[1:]), units, meaning)

    homes = np.stack([rig.home for rig in rigs]).reshape(*shape, -1)
    return {
        "rig": of_rig(lambda rig: rig.name, "1", "name of the rig"),
        "kind": of_rig(lambda rig: rig.kind, "1", "kind of the rig"),
        "up": of_rig(lambda rig: rig.up or "", "1", "axis of the world that points up"),
        "module": label(("module",), np.arange(most), "1", "number of the module"),
        "axis": label(("axis",), np.array(axes), "1", "axis of the world or of the platform"),
        "home": label((*dims, "axis"), homes, "m", "home position of the rig"),
        "module_name": of_modules(lambda rig: [each.name for each in rig.modules], "1", "name of the module"),
        "anchor": of_modules(anchors, "m", "anchor of the module in the world", "axis"),
        "attachment": of_modules(
            lambda rig: rig.attachments, "m", "attachment of the cable in platform axes", "axis"
        ),
        "lower": of_modules(lambda rig: rig.limits.lower, "N", "minimum tension of the cable"),
        "upper": of_modules(lambda rig: rig.limits.upper, "N", "maximum tension of the cable"),
        "required": of_rig(
            lambda rig: plan.requirement(rig).describe(rig), "1", "what the cables must exert at every pose"
        ),
        "characteristic_length": of_rig(
            lambda rig: plan.requirement(rig).length_for(rig), "m", "arm at which torques count as forces"
        ),
    }


def _digest(labels: Mapping[str, Label], texts: Sequence[str] = ()) -> str:
    digest = hashlib.sha256("\n".join(texts).encode())
    for name, (dims, values, _) in labels.items():
        digest.update(repr((name, dims, values.dtype, values.shape)).encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
