"""Summary of a sweep: a row for each configuration and metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.workspace.sweep.store import require_complete
from tensionlab.workspace.volume import equal_weights, node_weights, weighted_share

if TYPE_CHECKING:
    import pandas
    import xarray

MEDIAN_SAMPLE = 4_000_000  # values of which the median is exact; of more, every second is taken, or third, ...


def summary(swept: xarray.Dataset) -> pandas.DataFrame:
    """Return a table with a row for each configuration and metric of a sweep.

    Its columns are ``rig``, ``metric``, ``unit``, the number of ``poses`` and of those that are ``missing`` a
    value, ``min``, ``median`` and ``max``, and in ``above_zero`` the share of the volume (of the poses of a list)
    where the metric is above zero.

    Parameters
    ----------
    swept : Dataset
        Result of `tensionlab.sweep`. SweepError if values are missing in its store, or damaged.

    Examples
    --------
    >>> import tensionlab as tl
    >>> poses = tl.workspace.box([-0.2, 0.2], 0.3, [-0.2, 0.2], step=0.1)
    >>> table = tl.workspace.summary(tl.sweep(tl.load_rig("floor-3"), poses, "capacity-margin"))
    >>> table[["rig", "poses", "missing"]].values.tolist()
    [['floor-3', 25, 0]]
    """
    require_complete(swept)
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
    weights = [
        node_weights(values[dim].to_numpy()) if dim in ("x", "y", "z") else equal_weights(length)
        for dim, length in values.sizes.items()
    ]
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


def _read(values: xarray.DataArray) -> Floats:
    try:
        return np.asarray(values.values)
    except (ValueError, OSError) as error:
        raise SweepError(f"{values.name}: its values are damaged ({error}); delete the store") from None
