"""Dataset of a sweep: its coordinates and attributes, and `summary`, a row for each configuration and metric."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model import pose
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.workspace.metrics import Metric
from tensionlab.workspace.poses import Label, label
from tensionlab.workspace.shares import node_weights, weighted_share
from tensionlab.workspace.sweep.plan import Plan, own_frames

if TYPE_CHECKING:
    import pandas
    import xarray

MEDIAN_SAMPLE = 4_000_000  # values of which the median is exact; of more, every second is taken, or third, ...


def empty_dataset(plan: Plan) -> xarray.Dataset:
    """Return the dataset of a sweep without values: its coordinates and attributes.

    Every rig is made on the way, and refused if it does not suit the poses or the metrics, or lacks a body frame.
    """
    rigs = list(plan.configurations.rigs())
    if unknown := sorted(set(plan.frames) - {name for rig in rigs for name in rig.at_rest}):
        raise SweepError(f'frames: no module or body is attached to "{unknown[0]}"; leave it out')
    if other := [rig for rig in rigs if rig.dimension != plan.poses.dimension]:
        raise SweepError(
            f'the poses have {plan.poses.dimension} coordinates; rig "{other[0].name}" ({other[0].kind}) needs '
            f"{other[0].dimension}; give it other poses, or a sweep of its own"
        )
    axes, poses, of_rigs = plan.configurations.labels(), plan.poses.labels(), _rig_labels(plan, rigs)
    for rig in {(rig.kind, rig.m): rig for rig in reversed(rigs)}.values():
        plan.check(rig)
    demands = {name: of_rigs.pop(name) for name in ("required", "characteristic_length")}
    of_rigs = {name: variable for name, variable in of_rigs.items() if name != "rig" or "rig" not in axes}
    names = Counter(chain(axes, of_rigs, demands, poses, (metric.name for metric in plan.metrics)))
    if twice := [name for name, count in names.items() if count > 1]:
        raise SweepError(f'two axes or variables of the sweep are called "{twice[0]}"; rename or leave out one')
    if slashed := [name for name in names if "/" in name]:
        raise SweepError(f'"{slashed[0]}" has a slash, and cannot name an axis or variable; rename it')
    manifest = provenance.manifest(sys.orig_argv)
    identity = {
        "rigs": _digest(
            axes | of_rigs,
            [repr((rig.bodies, rig.at_rest | own_frames(rig, plan.frames))) for rig in rigs if rig.bodies],
        ),
        "poses": _digest(poses),
        "required": _digest(demands, [repr(plan.requirement(rig)) for rig in rigs]),
        "metrics": {metric.name: metric.identity for metric in plan.metrics},
        "chunks": list(plan.chunks),
        "version": manifest["versions"]["tensionlab"],
    }
    empty: xarray.Dataset = provenance.import_xarray().Dataset(
        coords={**axes, **of_rigs, **demands, **poses},
        attrs={
            "title": f"tensionlab sweep: {', '.join(metric.name for metric in plan.metrics)}",
            "sweep": json.dumps(identity),
            "manifest": json.dumps(manifest),
        },
    )
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
    cable_count, axes = max(rig.m for rig in rigs), list("xyz"[: plan.poses.dimension])

    def anchors(rig: Rig) -> Floats:
        placed = pose.place_anchors(rig.modules, rig.anchors, own_frames(rig, plan.frames))
        if placed.ndim > 2:
            raise SweepError("frames: give one pose for each body frame; it is the same all over the sweep")
        return placed

    def attachments(rig: Rig) -> Floats:
        return rig.attachments @ rig.home_matrix.T

    def of_rig(value: Callable[[Rig], Any], units: str, meaning: str) -> Label:
        return label(dims, np.reshape([value(rig) for rig in rigs], shape), units, meaning)

    def of_modules(value: Callable[[Rig], Any], units: str, meaning: str, *more: str) -> Label:
        rows = [np.asarray(value(rig)) for rig in rigs]
        dtype = np.result_type(*rows)
        table = np.full((len(rigs), cable_count, *rows[0].shape[1:]), "" if dtype.kind == "U" else np.nan, dtype)
        for padded, row in zip(table, rows, strict=True):
            padded[: len(row)] = row
        return label((*dims, "module", *more), table.reshape(*shape, *table.shape[1:]), units, meaning)

    def demand(value: Callable[[Requirement, Rig], Any], units: str, meaning: str) -> Label:
        return of_rig(lambda rig: value(plan.requirement(rig), rig), units, meaning)

    homes = np.stack([rig.home for rig in rigs]).reshape(*shape, -1)
    return {
        "rig": of_rig(attrgetter("name"), "1", "name of the rig"),
        "kind": of_rig(attrgetter("kind"), "1", "kind of the rig"),
        "up": of_rig(lambda rig: rig.up or "", "1", "axis of the world that points up"),
        "module": label(("module",), np.arange(cable_count), "1", "number of the module"),
        "axis": label(("axis",), np.array(axes), "1", "axis of the world or of the platform"),
        "home": label((*dims, "axis"), homes, "m", "home position of the rig"),
        "module_name": of_modules(lambda rig: [module.name for module in rig.modules], "1", "name of the module"),
        "anchor": of_modules(anchors, "m", "anchor of the module in the world", "axis"),
        "attachment": of_modules(attachments, "m", "attachment of the cable as turned at home", "axis"),
        "lower": of_modules(attrgetter("limits.lower"), "N", "minimum tension of the cable"),
        "upper": of_modules(attrgetter("limits.upper"), "N", "maximum tension of the cable"),
        "required": demand(Requirement.describe, "1", "what the cables must exert at every pose"),
        "characteristic_length": demand(Requirement.length_for, "m", "arm at which torques count as forces"),
    }


def _digest(labels: Mapping[str, Label], texts: Sequence[str] = ()) -> str:
    digest = hashlib.sha256("\n".join(texts).encode())
    for name, (dims, values, _) in labels.items():
        digest.update(repr((name, dims, values.dtype, values.shape)).encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def summary(swept: xarray.Dataset) -> pandas.DataFrame:
    """Return a table with a row for each configuration and metric of a sweep.

    Its columns are ``rig``, ``metric``, ``unit``, the number of ``poses`` and of those that are ``missing`` a
    value, ``min``, ``median`` and ``max``, and in ``above_zero`` the share of the volume (of the poses of a list)
    where the metric is above zero. SweepError if values in the store of what was ``swept`` are damaged.

    Examples
    --------
    >>> import tensionlab as tl
    >>> poses = tl.workspace.box([-0.2, 0.2], 0.3, [-0.2, 0.2], step=0.1)
    >>> table = tl.workspace.summary(tl.sweep(tl.load_rig("floor-3"), poses, "capacity-margin"))
    >>> table[["rig", "poses", "missing"]].values.tolist()
    [['floor-3', 25, 0]]
    """
    dims = [str(dim) for dim in swept["kind"].dims]
    rows = []
    for name, index in zip(configuration_names(swept), np.ndindex(*swept["kind"].shape), strict=True):
        part = swept.isel(dict(zip(dims, index, strict=True)))
        for metric, values in part.data_vars.items():
            rows.append({"rig": name, "metric": str(metric), "unit": str(values.units), **_statistics(values)})
    return provenance.data_frame(rows)


def configuration_names(swept: xarray.Dataset) -> list[str]:
    """Return the name of each configuration: its rig, or the parameters that tell it from the others."""
    dims = [str(dim) for dim in swept["kind"].dims]
    if dims in (["rig"], []):
        return [str(name) for name in np.atleast_1d(swept["rig"].to_numpy())]
    several = [dim for dim in dims if swept.sizes[dim] > 1] or dims
    labels = {dim: swept[dim].to_numpy() for dim in dims}
    return [
        ", ".join(f"{dim} {labels[dim][i]}" for dim, i in zip(dims, index, strict=True) if dim in several)
        for index in np.ndindex(*swept["kind"].shape)
    ]


def _statistics(values: xarray.DataArray) -> dict[str, float]:
    """Return a variable's columns of the summary, a slab along the first axis at a time. NaN is not above zero."""
    weights = [_axis_weights(values, str(dim)) for dim in values.dims]
    first = values.encoding.get("chunks", values.shape)[-values.ndim]
    stride = -(-values.size // MEDIAN_SAMPLE)
    above, lows, highs, sample, count = 0.0, [], [], [], 0
    for start in range(0, values.shape[0], first):
        slab = _read(values[start : start + first])
        above += float(weighted_share(slab > 0, [weights[0][start : start + first], *weights[1:]]))
        slab = slab[~np.isnan(slab)]
        lows.append(slab.min(initial=np.inf))
        highs.append(slab.max(initial=-np.inf))
        sample.append(slab[::stride])
        count += slab.size
    statistics = [min(lows), np.median(np.concatenate(sample)), max(highs), above] if count else [np.nan] * 4
    named = dict(zip(("min", "median", "max", "above_zero"), map(float, statistics), strict=True))
    return {"poses": values.size, "missing": values.size - count, **named}


def _axis_weights(values: xarray.DataArray, dim: str) -> Floats:
    """Return the share of the whole that belongs to each value along an axis; poses of a list share it evenly."""
    if dim in ("x", "y", "z"):
        return node_weights(values[dim].to_numpy())
    count = values.sizes[dim]
    return np.asarray(values.coords.get(f"{dim}_weight", np.full(count, 1.0 / count)))


def _read(values: xarray.DataArray) -> Floats:
    try:
        return np.asarray(values.values)
    except (ValueError, OSError) as error:
        raise SweepError(f"{values.name}: its values are damaged ({error}); delete the store") from None
