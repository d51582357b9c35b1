"""Every figure and table: which data it is drawn from, and what draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tensionlab as tl
from tensionlab import plots
from tensionlab.experiments import anchor_count
from tensionlab.workspace import Grid

FIGURE = (".pdf", ".png")
DIGITS = 6
"""Swept values are rounded to so many, so that no processor's last digit is seen in a figure."""


@dataclass(frozen=True)
class Drawing:
    """Data -> figure: `load` takes the folder of the data sets, `draw` what it found and the file to write."""

    load: Callable[[Path], Any]
    draw: Callable[[Any, Path], None]
    suffixes: tuple[str, ...] = FIGURE


def rounded(swept: Any) -> Any:
    """The same sweep with rounded values."""
    for values in swept.data_vars.values():
        values.data = np.round(values.data, DIGITS)
    return swept


def sweeps_of_modules(folder: Path) -> Any:
    """Slices of published rigs, and three to eight modules in a room."""
    return [rounded(each) for each in anchor_count.sweep_published()], rounded(anchor_count.sweep_room())


def sweep_of_rooms(folder: Path) -> Any:
    """An upright slice through home of the validation's rig, sides of 1.0 and 0.3 m, and of seven modules."""
    names = ("bartels2026-validation", "bartels2026-validation-0.3m", "seven-modules")
    grid = Grid(np.linspace(-1.5, 1.5, 301), np.linspace(0.0, 2.4, 193), np.array([0.0]))
    rigs = [tl.datasets.load(f"rigs/{name}", folder) for name in names]
    return rounded(tl.sweep(rigs, grid, ["capacity-margin", "tension-factor"], progress=False))


DRAWINGS = {
    "anchor-count": Drawing(sweeps_of_modules, lambda data, path: plots.plot_anchor_count(*data, path)),
    "time-accuracy": Drawing(lambda folder: tl.datasets.load("benchmarks/results", folder), plots.plot_summary),
    "workspace": Drawing(sweep_of_rooms, plots.plot_measures),
}
"""By the name of the file, without its suffix."""
