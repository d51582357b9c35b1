"""A run as an `xarray.Dataset`, with names, units and labels to every array; and as plain columns."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from itertools import product
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import MissingDependency
from tensionlab.files import writing
from tensionlab.hardware.log.columns import COLUMNS, IMPEDANCE
from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig

if TYPE_CHECKING:
    import xarray

    from tensionlab.hardware.log.reader import Run


def labels(rig: Rig) -> dict[str, list[str]]:
    """What are the entries along each dimension of the columns called?"""
    axes = list("xyz"[: rig.dimension])
    torques = [] if rig.n == rig.dimension else ["z"] if rig.dimension == 2 else axes
    return {
        "module": [module.name for module in rig.modules],
        "component": [f"F{axis}" for axis in axes] + [f"M{axis}" for axis in torques],
        "axis": axes,
        "platform_axis": axes,
        "impedance": list(IMPEDANCE),
    }


def flat_columns(run: Run) -> dict[str, NDArray[Any]]:
    """Which columns of one number a cycle hold a run? Called ``chosen.floor-1``, ``structure.Fx.floor-1``, ..."""
    names = labels(run.rig)
    return {
        ".".join([name, *words]): getattr(run, name)[(slice(None), *index)]
        for name, column in COLUMNS.items()
        for index, words in _entries([names[dim] for dim in column.dims])
    }


def _entries(words: list[list[str]]) -> Iterator[tuple[tuple[int, ...], tuple[str, ...]]]:
    """Which entries has an array with these labels along its dimensions, and what are they called?"""
    indices = product(*(range(len(each)) for each in words))
    return zip(indices, product(*words), strict=True)


def to_dataset(run: Run) -> xarray.Dataset:
    """Which dataset holds a run?

    Every column of `CycleTable` is a variable with the dimension ``cycle`` and its own, and has ``units`` and a
    ``long_name``. The dataset's attributes have what was around the cycles: ``rig`` in TOML; ``manifest``,
    ``setup``, ``modules``, ``summary`` and ``events`` in JSON; ``began``, in s since 1970; ``complete``, 1 or 0.

    Raises
    ------
    MissingDependency
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingDependency('datasets need xarray: pip install "tensionlab[workspace]"') from error
    lower, upper = np.array(run.setup.lower), np.array(run.setup.upper)
    limits = {
        "lower": ("module", lower, {"units": "N", "long_name": "least tension that the solver may choose"}),
        "upper": ("module", upper, {"units": "N", "long_name": "largest tension that the solver may choose"}),
    }
    table = {
        name: (("cycle", *column.dims), getattr(run, name), {"units": column.unit, "long_name": column.meaning})
        for name, column in COLUMNS.items()
    }
    coordinates = {"cycle": table.pop("cycle"), "time": table.pop("time"), **limits}
    return xarray.Dataset(
        table,
        {**labels(run.rig), **coordinates},
        {
            "title": f"tensionlab run: {run.rig.name}, {run.setup.solver}",
            "rig": rig_to_toml(run.rig),
            "manifest": json.dumps(dict(run.manifest)),
            "setup": json.dumps(asdict(run.setup)),
            "modules": json.dumps(dict(run.modules)),
            "summary": json.dumps(dict(run.summary)),
            "events": json.dumps([asdict(event) for event in run.events]),
            "began": run.began,
            "complete": int(run.complete),
        },
    )


def write_netcdf(run: Run, path: str | PathLike[str]) -> None:
    """Write the dataset of a run to a NetCDF file (version 3, 64-bit offsets), which nearly everything reads.

    That version knows no 64-bit integers and no truth values: they become 32-bit integers and bytes.

    Raises
    ------
    MissingDependency
        As `to_dataset`.
    WriteError
        If the file cannot be written; what was there before stays.
    """
    writing.write_bytes(path, bytes(to_dataset(run).to_netcdf(engine="scipy")))
