"""A run as an `xarray.Dataset`: names, units and labels to every array."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from tensionlab.errors import MissingDependency
from tensionlab.hardware.columns import COLUMNS, IMPEDANCE
from tensionlab.model.files import rig_to_toml

if TYPE_CHECKING:
    import xarray

    from tensionlab.hardware.run_record import Run


def to_dataset(run: Run) -> xarray.Dataset:
    """Which dataset holds a run?

    Every column of `CycleTable` is a variable with the dimension ``cycle`` and its own, and has ``units`` and a
    ``long_name``. The dataset's attributes have what was around the cycles: ``rig`` in TOML; ``manifest``,
    ``setup``, ``modules``, ``summary`` and ``events`` in JSON; ``complete``, 1 or 0.

    Raises
    ------
    MissingDependency
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingDependency('datasets need xarray: pip install "tensionlab[workspace]"') from error
    axes = list("xyz"[: run.rig.dimension])
    torques = [] if run.rig.n == run.rig.dimension else ["z"] if run.rig.dimension == 2 else axes
    labels = {
        "module": [module.name for module in run.rig.modules],
        "component": [f"F{axis}" for axis in axes] + [f"M{axis}" for axis in torques],
        "axis": axes,
        "platform_axis": axes,
        "impedance": list(IMPEDANCE),
    }
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
        {**labels, **coordinates},
        {
            "title": f"tensionlab run: {run.rig.name}, {run.setup.solver}",
            "rig": rig_to_toml(run.rig),
            "manifest": json.dumps(dict(run.manifest)),
            "setup": json.dumps(asdict(run.setup)),
            "modules": json.dumps(dict(run.modules)),
            "summary": json.dumps(dict(run.summary)),
            "events": json.dumps([asdict(event) for event in run.events]),
            "complete": int(run.complete),
        },
    )
