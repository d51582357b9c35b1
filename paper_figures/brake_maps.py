"""Figure of the directions in which a rig's brakes hold walls."""

from __future__ import annotations

from typing import Any

import numpy as np

from tensionlab.haptics.rendering.brakes import BrakeMap
from tensionlab.plots.style import add_legend, new_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import RED

MAP_ROWS, MAP_COLUMNS = 91, 181  # size of the grid of normals of a brake map


def map_normals() -> Floats:
    """Return the normals of walls (K, 3) that `plot_brake_maps` needs: all latitudes and longitudes; y is up."""
    latitude, longitude = _grid()
    components = [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)]
    return np.stack(components, axis=-1).reshape(-1, 3)


def plot_brake_maps(maps: dict[str, BrakeMap], cables: Floats) -> Any:
    """Draw, for walls of all normals, the force of a push that stays unresisted.

    Side by side, by their titles, maps over `map_normals` at one position; the structure matrix (3, m) there tells
    where the cables point.

    Parameters
    ----------
    maps : mapping of str to BrakeMap
        By what resists.
    cables : (3, m) array
        Structure matrix at the position of the maps.
    """
    latitude, longitude = _grid()
    with new_figure((4.8 * len(maps), 3.3), dpi=120) as figure:
        panels: Any = figure.subplots(1, len(maps), squeeze=False, subplot_kw={"projection": "mollweide"})
        for axes, (title, found) in zip(panels[0], maps.items(), strict=True):
            force = found.chosen.unresisted.reshape(MAP_ROWS, MAP_COLUMNS)
            shades = axes.pcolormesh(
                longitude, latitude, force, vmin=0.0, vmax=found.force, cmap="viridis_r", rasterized=True
            )
            axes.plot(
                np.arctan2(cables[0], cables[2]), np.arcsin(cables[1].clip(-1.0, 1.0)), "o", color=RED,
                markeredgecolor="white", clip_on=False,
            )  # fmt: skip
            mean = _mean(found.chosen.unresisted)
            axes.set_title(f"{title} leave {mean:.0f} of {found.force:g} N unresisted (mean)", pad=16.0)
            for height, word, side in (
                (1.01, "floor: normal up", "bottom"),
                (-0.01, "ceiling: normal down", "top"),
            ):
                axes.text(0.5, height, word, transform=axes.transAxes, ha="center", va=side, fontsize=8)
            axes.set(xticks=[], yticks=[])
        figure.colorbar(shades, ax=panels, label="push that stays unresisted (N)", shrink=0.8)
        add_legend(figure, 1, [
            ("where a cable points", {"color": RED, "marker": "o", "markeredgecolor": "white", "linestyle": ""}),
        ])  # fmt: skip
    return figure


def _grid() -> tuple[Floats, Floats]:
    latitude, longitude = np.linspace(-np.pi / 2, np.pi / 2, MAP_ROWS), np.linspace(-np.pi, np.pi, MAP_COLUMNS)
    rows, columns = np.meshgrid(latitude, longitude, indexing="ij")
    return rows, columns


def _mean(values: Any) -> float:
    """Return the mean over the sphere: the rows of the grid are shorter near the poles."""
    return float(np.average(values, weights=np.cos(_grid()[0]).ravel()))
