"""Dataset of a sweep: coordinates of configurations, rigs and poses, attributes of metrics, and summaries."""

from __future__ import annotations

import hashlib
import itertools
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model import pose
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count
from tensionlab.support.table import table
from tensionlab.workspace.metrics import Metric, description
from tensionlab.workspace.poses import Coordinate
from tensionlab.workspace.sweep.plan import Plan
from tensionlab.workspace.volume import describe_step, equal_weights, node_weights, weighted_share

if TYPE_CHECKING:
    import pandas
    import xarray

MEDIAN_SAMPLE = 4_000_000
"""Values that a median is taken of, at most; of a larger sweep every second one, or every third, and so on."""
SUMMARY_HEADINGS = ("<rig", "<metric", "<unit", "min", "median", "max", "above 0", "no value")
"""Of the table of a `SweepSummary`, in notebooks and on terminals."""


def empty_dataset(plan: Plan) -> xarray.Dataset:
    """Return the dataset of a sweep without values: its coordinates and attributes.

    Every rig is made on the way, and refused if it does not suit the poses or the metrics, or lacks a body frame.
    """
    of_rigs, demands = _rig_coordinates(plan)
    found = [*plan.configurations.coordinates(), *of_rigs, *plan.poses.coordinates()]
    names = Counter([each.name for each in found] + list(plan.metrics))
    if twice := [name for name, count in names.items() if count > 1]:
        raise SweepError(f'two axes or variables of the sweep are called "{twice[0]}"; rename one')
    if slashed := [name for name in names if "/" in name]:
        raise SweepError(f'"{slashed[0]}" has a slash, and cannot name an axis or variable; rename it')
    manifest = provenance.manifest(sys.orig_argv)
    labels = {
        each.name: (each.dims, each.values, {"units": each.units, "long_name": each.long_name}) for each in found
    }
    attrs = {
        "title": f"tensionlab sweep: {', '.join(plan.metrics)}",
        "sweep": json.dumps(_identity(plan, found, demands, manifest["versions"]["tensionlab"])),
        "manifest": json.dumps(manifest),
    }
    empty: xarray.Dataset = provenance.import_xarray().Dataset(coords=labels, attrs=attrs)
    return empty


def attributes(metric: Metric) -> dict[str, str]:
    """Return the attributes of a metric's variable; ``measure`` is what makes the metric again."""
    return {
        "units": metric.unit,
        "long_name": metric.title,
        "description": description(metric),
        "measure": repr(metric),
    }


def _rig_coordinates(plan: Plan) -> tuple[list[Coordinate], str]:
    """Return what labels the rig of every configuration, and a text of what is required of each, if anything is.

    Its anchors, attachments and limits are NaN for modules that it lacks.
    """
    shape, dims = plan.configurations.shape, plan.configurations.dims
    names, rows, homes, arms, demands = [], [], [], [], []
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
        required = plan.requirement(rig)
        if required or rig.n > rig.dimension:
            demands.append(f"{required} at {required.length_for(rig)} m")
        labels = [module.name for module in rig.modules]
        names.append((rig.name, rig.kind, rig.up or "", required.describe(rig), labels))
        arms.append(required.length_for(rig))
        rows.append((anchors, rig.attachments, rig.limits.lower, rig.limits.upper))
    if unknown := sorted(set(plan.frames) - used):
        raise SweepError(f'frames: no module rides on "{unknown[0]}"; leave it out')

    most = max(len(row[0]) for row in rows)
    anchors, attachments, lower, upper = (_padded([row[i] for row in rows], most, shape) for i in range(4))
    titles, kinds, ups, words = (np.array([row[i] for row in names]).reshape(shape) for i in range(4))
    modules = np.array([own + [""] * (most - len(own)) for *_, own in names]).reshape(*shape, most)
    axes = "xyz"[: plan.poses.dimension]
    each = (*dims, "module")
    found = [
        Coordinate("kind", dims, kinds, "1", "kind of the rig"),
        Coordinate("up", dims, ups, "1", "axis of the world that points up; empty: not known"),
        Coordinate("required", dims, words, "1", "what the cables must exert at every pose"),
        Coordinate("characteristic_length", dims, np.reshape(arms, shape), "m", "arm of torques as forces"),
        Coordinate("module", ("module",), np.arange(most), "1", "number of the module"),
        Coordinate("axis", ("axis",), np.array(list(axes)), "1", "axis of the world or of the platform"),
        Coordinate("home", (*dims, "axis"), np.stack(homes).reshape(*shape, -1), "m", "home position of the rig"),
        Coordinate("module_name", each, modules, "1", "name of the module"),
        Coordinate("anchor", (*each, "axis"), anchors, "m", "anchor of the module in the world"),
        Coordinate("attachment", (*each, "axis"), attachments, "m", "attachment of the cable in platform axes"),
        Coordinate("lower", each, lower, "N", "minimum tension of the cable"),
        Coordinate("upper", each, upper, "N", "maximum tension of the cable"),
    ]
    if "rig" not in dims:
        found.insert(0, Coordinate("rig", dims, titles, "1", "name of the rig"))
    return found, "; ".join(demands)


def _padded(rows: list[Floats], length: int, shape: tuple[int, ...]) -> Floats:
    """Return rows of different lengths in one array, with NaN behind the shorter ones."""
    table = np.full((len(rows), length, *rows[0].shape[1:]), np.nan)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table.reshape(*shape, *table.shape[1:])


def _identity(plan: Plan, found: Sequence[Coordinate], demands: str, version: str) -> dict[str, Any]:
    """Return what tells a sweep from every other; stores are compared by it."""
    of_poses = plan.poses.coordinates()
    names = {"required", "characteristic_length", *(each.name for each in of_poses)}
    return {
        "rigs": _digest([each for each in found if each.name not in names]),
        "poses": _digest(of_poses),
        **({"required": hashlib.sha256(demands.encode()).hexdigest()} if demands else {}),
        "metrics": {name: repr(metric) for name, metric in plan.metrics.items()},
        "chunks": list(plan.chunks),
        "version": version,
    }


def _digest(found: Sequence[Coordinate]) -> str:
    digest = hashlib.sha256()
    for each in found:
        digest.update(repr((each.name, each.dims, each.values.dtype, each.values.shape)).encode())
        digest.update(np.ascontiguousarray(each.values).tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Summary:
    """Statistics of a metric over many poses; NaN if none has a value."""

    poses: int
    missing: int
    """Poses without a value."""
    min: float
    median: float
    max: float
    above_zero: float
    """Share of the volume where it is above zero, by `node_weights`; of the poses where they are a list."""


@dataclass(frozen=True)
class SweepSummary:
    """Summaries of all metrics of a sweep, by configuration, metric and unit ("1" for none)."""

    rows: tuple[tuple[str, str, str, Summary], ...]
    step: str = ""
    """How far apart the positions of a grid are, such as "0.1 m apart"; empty for a list of poses."""

    def __repr__(self) -> str:
        metrics = dict.fromkeys(metric for _, metric, *_ in self.rows)
        rigs = len(self.rows) // max(len(metrics), 1)
        size = f"{format_count(self._poses, 'pose')}, {format_count(rigs, 'rig')}"
        return f"<SweepSummary of {', '.join(metrics)} at {size}>"

    def _repr_html_(self) -> str:
        rows = [
            [rig, metric, unit.removeprefix("1"), each.min, each.median, each.max,
             "–" if np.isnan(each.above_zero) else f"{100 * each.above_zero:.1f} %", each.missing]
            for rig, metric, unit, each in self.rows
        ]  # fmt: skip
        return table(" ".join(filter(None, (f"{self._poses:,} poses", self.step))), SUMMARY_HEADINGS, rows)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each configuration and metric; MissingDependency if pandas is not installed."""
        return provenance.data_frame(
            [{"rig": rig, "metric": metric, "unit": unit, **vars(each)} for rig, metric, unit, each in self.rows]
        )

    @property
    def _poses(self) -> int:
        return self.rows[0][-1].poses


def summary(swept: xarray.Dataset) -> SweepSummary:
    """Summarise every metric of a sweep for each of its configurations.

    Parameters
    ----------
    swept : Dataset
        From `tensionlab.sweep`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> poses = tl.workspace.box([-0.2, 0.2], 0.3, [-0.2, 0.2], step=0.1)
    >>> tl.workspace.summary(tl.sweep(tl.load_rig("floor-3"), poses, "capacity-margin", progress=False))
    <SweepSummary of capacity-margin at 25 poses, 1 rig>
    """
    dims = [str(dim) for dim in swept["kind"].dims]
    found = []
    for name, index in zip(
        configuration_names(swept), np.ndindex(*(swept.sizes[dim] for dim in dims)), strict=True
    ):
        part = swept.isel(dict(zip(dims, index, strict=True)))
        found += [
            (name, str(each), str(values.units), summarise(values)) for each, values in part.data_vars.items()
        ]
    return SweepSummary(
        tuple(found), describe_step(swept[axis].to_numpy() for axis in "xyz" if axis in swept.dims)
    )


def configuration_names(swept: xarray.Dataset) -> list[str]:
    """Return the name of each configuration: its rig, or the parameters that tell it from the others."""
    dims = [str(dim) for dim in swept["kind"].dims]
    if dims in (["rig"], []):
        return [str(name) for name in np.atleast_1d(swept["rig"].to_numpy())]
    several = [dim for dim in dims if swept.sizes[dim] > 1] or dims
    labels = {dim: swept[dim].to_numpy() for dim in dims}
    index = np.ndindex(*(swept.sizes[dim] for dim in dims))
    return [
        ", ".join(f"{dim} {labels[dim][i]}" for dim, i in zip(dims, where, strict=True) if dim in several)
        for where in index
    ]


def summarise(values: xarray.DataArray) -> Summary:
    """Summarise a variable of a sweep, or a part of it; one chunk of a store is read at a time.

    A pose without a value counts as one where the metric is not above zero.
    """
    parts = values.encoding.get("preferred_chunks", {})
    sizes = [parts.get(dim, length) for dim, length in values.sizes.items()]
    stride = -(-values.size // MEDIAN_SAMPLE)
    low, high = np.inf, -np.inf
    weights = [
        node_weights(values[dim].to_numpy()) if dim in ("x", "y", "z") else equal_weights(length)
        for dim, length in values.sizes.items()
    ]
    count, above = 0, 0.0
    sample = []
    for start in itertools.product(*map(range, itertools.repeat(0), values.shape, sizes)):
        block = tuple(slice(first, first + size) for first, size in zip(start, sizes, strict=True))
        part = values[block].values
        above += float(weighted_share(part > 0, [along[own] for along, own in zip(weights, block, strict=True)]))
        part = part[~np.isnan(part)]
        if part.size:
            low, high = min(low, part.min()), max(high, part.max())
            count += part.size
            sample.append(part[::stride])
    if not count:
        return Summary(values.size, values.size, np.nan, np.nan, np.nan, np.nan)
    median = float(np.median(np.concatenate(sample)))
    return Summary(values.size, values.size - count, float(low), median, float(high), above)
