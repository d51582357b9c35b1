"""Which walls does a rig hold? Its map of brakeable directions, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.style import RED, add_legend, new_figure

if TYPE_CHECKING:
    from tensionlab.arrays import Floats
    from tensionlab.haptics.brakes.map import BrakeMap

ROWS, COLUMNS = 61, 121
"""Of the grid of normals."""


def map_normals() -> Floats:
    """Which normals does the picture need? All latitudes and longitudes around y, (ROWS * COLUMNS, 3)."""
    latitude, longitude = _grid()
    components = [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)]
    return np.stack(components, axis=-1).reshape(-1, 3)


def plot_brake_maps(maps: dict[str, BrakeMap], cables: Floats, path: str | Path) -> None:
    """Draw, for all walls, which share of a push stays unresisted.

    Parameters
    ----------
    maps : dict
        By title, side by side: maps over `map_normals`, at one position each.
    cables : (3, m) array
        Structure matrix there: where the cables point.
    path : path
        The suffix chooses the format: png, pdf or svg.
    """
    latitude, longitude = _grid()
    with new_figure(path, (5.2 * len(maps), 3.6), dpi=110) as figure:
        panels: Any = figure.subplots(1, len(maps), squeeze=False, subplot_kw={"projection": "mollweide"})
        for axes, (title, found) in zip(panels[0], maps.items(), strict=True):
            left = (found.chosen.unresisted / found.force).reshape(ROWS, COLUMNS)
            shades = axes.pcolormesh(
                longitude, latitude, left, vmin=0.0, vmax=1.0, cmap="cividis_r", rasterized=True
            )
            axes.contour(longitude, latitude, np.degrees(found.off).reshape(ROWS, COLUMNS), [45.0], colors="black")
            axes.plot(np.arctan2(cables[0], cables[2]), np.arcsin(cables[1].clip(-1.0, 1.0)), "o", color=RED)
            axes.set_title(
                f"{title}: {_mean(found.chosen.unresisted):.1f} of {found.force:g} N unresisted,\n"
                f"{100 * _mean(found.off <= np.pi / 4):.0f} % of the walls met within 45°"
            )
            axes.set_xticklabels([])
            axes.set_yticklabels([])
            axes.grid(alpha=0.2)
        figure.colorbar(shades, ax=panels, label="share of the push that stays unresisted", shrink=0.8)
        add_legend(
            figure,
            2,
            [
                ("where a cable points", {"color": RED, "marker": "o", "linestyle": ""}),
                ("force 45° off the normal", {"color": "black"}),
            ],
        )


def _grid() -> tuple[Floats, Floats]:
    latitude, longitude = np.linspace(-np.pi / 2, np.pi / 2, ROWS), np.linspace(-np.pi, np.pi, COLUMNS)
    rows, columns = np.meshgrid(latitude, longitude, indexing="ij")
    return rows, columns


def _mean(values: Any) -> float:
    """Mean over the sphere: the rows of the grid are shorter near the poles."""
    return float(np.average(values, weights=np.cos(_grid()[0]).ravel()))
