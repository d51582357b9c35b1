"""Dataset of a sweep: coordinates of configurations, rigs and poses, attributes of metrics."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model import pose
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
    rigs, demands = _rig_labels(plan)
    axes, poses = plan.configurations.labels(), plan.poses.labels()
    if "rig" in axes:
        del rigs["rig"]
    names = Counter(chain(axes, rigs, demands, poses, (each.name for each in plan.metrics)))
    if twice := [name for name, count in names.items() if count > 1]:
        raise SweepError(f'two axes or variables of the sweep are called "{twice[0]}"; rename one')
    if slashed := [name for name in names if "/" in name]:
        raise SweepError(f'"{slashed[0]}" has a slash, and cannot name an axis or variable; rename it')
    manifest = provenance.manifest(sys.orig_argv)
    identity = {
        "rigs": _digest(axes | rigs),
        "poses": _digest(poses),
        "required": _digest(demands, [repr(plan.requirement(rig)) for rig in plan.configurations.rigs()]),
        "metrics": {each.name: each.identity for each in plan.metrics},
        "chunks": list(plan.chunks),
        "version": manifest["versions"]["tensionlab"],
    }
    attrs = {
        "title": f"tensionlab sweep: {', '.join(each.name for each in plan.metrics)}",
        "sweep": json.dumps(identity),
        "manifest": json.dumps(manifest),
    }
    coordinates = {**axes, **rigs, **demands, **poses}
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


def _rig_labels(plan: Plan) -> tuple[dict[str, Label], dict[str, Label]]:
    """Return what labels the rig of every configuration, and what is required of it.

    Anchors, attachments and limits are NaN for modules that a rig lacks.
    """
    shape, dims = plan.configurations.shape, plan.configurations.dims
    rigs = list(plan.configurations.rigs())
    if unknown := sorted(set(plan.frames) - {name for rig in rigs for name in rig.frames}):
        raise SweepError(f'frames: no module is attached to "{unknown[0]}"; leave it out')
    anchors = []
    seen: set[tuple[str, int]] = set()
    for rig in rigs:
        own = {name: plan.frames[name] for name in rig.frames if name in plan.frames}
        anchors.append(pose.place_anchors(rig.modules, rig.anchors, own))
        if anchors[-1].ndim > 2:
            raise SweepError("frames: give one pose for each body frame; it is the same all over the sweep")
        if (rig.kind, rig.m) not in seen:
            plan.check(rig)
            seen.add((rig.kind, rig.m))
    most, axes = max(rig.m for rig in rigs), list("xyz"[: plan.poses.dimension])
    of_module = (*dims, "module")

    def texts(values: Sequence[str]) -> Any:
        return np.array(values).reshape(shape)

    def table(rows: Sequence[Floats]) -> Floats:
        padded = np.full((len(rows), most, *rows[0].shape[1:]), np.nan)
        for row, values in zip(padded, rows, strict=True):
            row[: len(values)] = values
        return padded.reshape(*shape, *padded.shape[1:])

    names = [[module.name for module in rig.modules] + [""] * (most - rig.m) for rig in rigs]
    homes = np.stack([rig.home for rig in rigs]).reshape(*shape, -1)
    attachments = table([rig.attachments for rig in rigs])
    labels = {
        "rig": label(dims, texts([rig.name for rig in rigs]), "1", "name of the rig"),
        "kind": label(dims, texts([rig.kind for rig in rigs]), "1", "kind of the rig"),
        "up": label(dims, texts([rig.up or "" for rig in rigs]), "1", "axis of the world that points up"),
        "module": label(("module",), np.arange(most), "1", "number of the module"),
        "axis": label(("axis",), np.array(axes), "1", "axis of the world or of the platform"),
        "home": label((*dims, "axis"), homes, "m", "home position of the rig"),
        "module_name": label(of_module, np.array(names).reshape(*shape, most), "1", "name of the module"),
        "anchor": label((*of_module, "axis"), table(anchors), "m", "anchor of the module in the world"),
        "attachment": label((*of_module, "axis"), attachments, "m", "attachment of the cable in platform axes"),
        "lower": label(of_module, table([rig.limits.lower for rig in rigs]), "N", "minimum tension of the cable"),
        "upper": label(of_module, table([rig.limits.upper for rig in rigs]), "N", "maximum tension of the cable"),
    }
    words = [plan.requirement(rig).describe(rig) for rig in rigs]
    arms = np.reshape([plan.requirement(rig).length_for(rig) for rig in rigs], shape)
    demands = {
        "required": label(dims, texts(words), "1", "what the cables must exert at every pose"),
        "characteristic_length": label(dims, arms, "m", "arm at which torques count as forces"),
    }
    return labels, demands


def _digest(labels: Mapping[str, Label], texts: Sequence[str] = ()) -> str:
    digest = hashlib.sha256("\n".join(texts).encode())
    for name, (dims, values, _) in labels.items():
        digest.update(repr((name, dims, values.dtype, values.shape)).encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
