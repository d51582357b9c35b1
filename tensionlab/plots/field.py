"""A swept measure as the pictures need it: one array of values for each rig, with the rig's anchors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Field:
    """One measure over a grid, for each of several rigs.

    Attributes
    ----------
    values : (rigs, *grid) array
        NaN where a cable has no length.
    axes : mapping of name to array
        Coordinates along each axis of the grid, in m.
    names : list of str
        Of the rigs.
    anchors, ends : lists of (m, d) arrays
        Of the cables, with the platform at home, in m.
    label : str
        Of the measure, with its unit.
    up : str
        Name of the axis that points up.
    """

    values: Floats
    axes: dict[str, Floats]
    names: list[str]
    anchors: list[Floats]
    ends: list[Floats]
    label: str
    up: str


def read_field(swept: xarray.Dataset, measure: str | None = None) -> Field:
    """Which values, and which rigs, are in a sweep?

    Raises
    ------
    ShapeError
        If the sweep has no such measure, or is not over a grid of positions alone.
    """
    if measure is None:
        measure = str(next(iter(swept.data_vars)))
    if measure not in swept.data_vars:
        known = ", ".join(str(name) for name in swept.data_vars)
        raise ShapeError(f'the sweep has no measure "{measure}"; it has {known}')
    values = swept[measure]
    axes = {name: swept[name].to_numpy() for name in "xyz" if name in values.dims}
    configurations = swept["kind"].dims
    other = [str(name) for name in values.dims if name not in axes and name not in configurations]
    if other or len(axes) < 2:
        raise ShapeError(f"pictures need a sweep over a grid of positions; this one has the axes {values.dims}")
    anchors, ends = (
        each.transpose(*configurations, "module", "axis").to_numpy().reshape(-1, *each.shape[-2:])
        for each in (swept["anchor"], swept["attachment"] + swept["home"])
    )
    there = ~np.isnan(anchors).any(axis=-1)
    ups = {str(up) for up in np.atleast_1d(swept["up"].to_numpy()).ravel()}
    attributes = values.attrs
    unit = "" if attributes["units"] == "1" else f" ({attributes['units']})"
    return Field(
        values=values.transpose(*configurations, *axes).to_numpy().reshape(-1, *(len(a) for a in axes.values())),
        axes=axes,
        names=_names(swept, [str(dim) for dim in configurations]),
        anchors=[each[own] for each, own in zip(anchors, there, strict=True)],
        ends=[each[own] for each, own in zip(ends, there, strict=True)],
        label=f"{attributes['long_name']}{unit}",
        up=(ups.pop().strip("-") or "y") if len(ups) == 1 else list(axes)[-1],
    )


def _names(swept: xarray.Dataset, dims: list[str]) -> list[str]:
    """What each configuration is called: its rig, or the parameters that tell it from the others."""
    if dims == ["rig"]:
        return [str(name) for name in swept["rig"].to_numpy()]
    several = [dim for dim in dims if swept.sizes[dim] > 1] or dims
    labels = {dim: swept[dim].to_numpy() for dim in dims}
    index = np.ndindex(*(swept.sizes[dim] for dim in dims))
    return [
        ", ".join(f"{dim} {labels[dim][i]}" for dim, i in zip(dims, where, strict=True) if dim in several)
        for where in index
    ]
