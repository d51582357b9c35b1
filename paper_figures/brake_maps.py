"""Figure of the directions in which a rig's brakes hold walls."""

from __future__ import annotations

from typing import Any

import numpy as np

from tensionlab.haptics.rendering.brakes import BrakeMap
from tensionlab.plots.style import add_legend, new_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import RED

MAP_ROWS, MAP_COLUMNS = 61, 121  # size of the grid of normals of a brake map


def map_normals() -> Floats:
    """Return the normals of walls (K, 3) that `plot_brake_maps` needs: all latitudes and longitudes around y."""
    latitude, longitude = _grid()
    components = [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)]
    return np.stack(components, axis=-1).reshape(-1, 3)


def plot_brake_maps(maps: dict[str, BrakeMap], cables: Floats) -> Any:
    """Draw, for walls of all normals, which share of a push stays unresisted.

    Side by side, by their titles, maps over `map_normals` at one position; the structure matrix (3, m) there tells
    where the cables point.

    Parameters
    ----------
    maps : mapping of str to BrakeMap
        By their titles.
    cables : (3, m) array
        Structure matrix at the position of the maps.
    """
    latitude, longitude = _grid()
    with new_figure((5.2 * len(maps), 3.6), dpi=110) as figure:
        panels: Any = figure.subplots(1, len(maps), squeeze=False, subplot_kw={"projection": "mollweide"})
        for axes, (title, found) in zip(panels[0], maps.items(), strict=True):
            left = (found.chosen.unresisted / found.force).reshape(MAP_ROWS, MAP_COLUMNS)
            shades = axes.pcolormesh(
                longitude, latitude, left, vmin=0.0, vmax=1.0, cmap="cividis_r", rasterized=True
            )
            axes.contour(
                longitude,
                latitude,
                np.degrees(found.angles).reshape(MAP_ROWS, MAP_COLUMNS),
                [45.0],
                colors="black",
            )
            axes.plot(np.arctan2(cables[0], cables[2]), np.arcsin(cables[1].clip(-1.0, 1.0)), "o", color=RED)
            axes.set_title(
                f"{title}: {_mean(found.chosen.unresisted):.1f} of {found.force:g} N unresisted,\n"
                f"{100 * _mean(found.angles <= np.pi / 4):.0f} % of the walls met within 45°"
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
    return figure


def _grid() -> tuple[Floats, Floats]:
    latitude, longitude = np.linspace(-np.pi / 2, np.pi / 2, MAP_ROWS), np.linspace(-np.pi, np.pi, MAP_COLUMNS)
    rows, columns = np.meshgrid(latitude, longitude, indexing="ij")
    return rows, columns


def _mean(values: Any) -> float:
    """Return the mean over the sphere: the rows of the grid are shorter near the poles."""
    return float(np.average(values, weights=np.cos(_grid()[0]).ravel()))
