"""The layouts of scenarios, side by side on one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.labels import label_points
from tensionlab.plots.scene import TILE, Moment, draw_scene, looks_of, origin_of, scripted
from tensionlab.plots.style import lines_of, new_figure

if TYPE_CHECKING:
    from tensionlab.arrays import Floats
    from tensionlab.scenarios import Scenario

COLUMNS = 3
WIDTH = 13.0
"""Of the picture, in inches."""
MARGIN = 0.12
"""Around each layout, in m."""
PRESSED = 0.002
"""A script that leads so far beyond where brakes hold presses against them, in m."""
LEAST = 1.0
"""Of a column's width and a row's height, in m: room for the legend."""
INSTANTS = 201
"""Of a script, for the path that it is."""


def plot_scenario_layouts(scenarios: Sequence[Scenario], note: str, path: str | Path) -> None:
    """Draw where modules stand in the room and on the body, with the hand or the head where its script leads it.

    Parameters
    ----------
    scenarios : sequence of Scenario
    note : str
        What is to be known about them all; it stands beside the legend.
    path : path
        The suffix chooses the format: png, pdf or svg.

    Raises
    ------
    ShapeError
        If the suffix is no such format.
    """
    rows = -(-(len(scenarios) + 1) // COLUMNS)  # one more place, for the legend
    with new_figure(path, (WIDTH, 1.0)) as figure:
        grid: Any = figure.add_gridspec(rows, COLUMNS)
        drawn = []
        for number, scenario in enumerate(scenarios):
            axes: Any = figure.add_subplot(grid[number // COLUMNS, number % COLUMNS])
            places, moment = way(scenario)
            names = draw_scene(axes, scenario, moment, places)
            axes.set_title(scenario.title)
            drawn.append((axes, names))
        boxes = np.array([axes.dataLim.get_points() for axes, _ in drawn])
        # One scale for all: all of a column are as wide as the widest, all of a row as high as the highest.
        spans = boxes[:, 1] - boxes[:, 0] + 2 * MARGIN
        widths = [spans[column::COLUMNS, 0].max(initial=LEAST) for column in range(COLUMNS)]
        heights = [spans[COLUMNS * row : COLUMNS * (row + 1), 1].max(initial=LEAST) for row in range(rows)]
        grid.set_width_ratios(widths)
        grid.set_height_ratios(heights)
        figure.set_size_inches(WIDTH, WIDTH * sum(heights) / sum(widths) + 0.35 * rows)
        for number, (axes, _) in enumerate(drawn):
            middle = boxes[number, :, 0].mean()
            bottom = boxes[number, 0, 1] - MARGIN
            axes.set_xlim(middle + np.array([-0.5, 0.5]) * widths[number % COLUMNS])
            axes.set_ylim(bottom, bottom + heights[number // COLUMNS])
        key: Any = figure.add_subplot(grid[-1, -1])
        key.axis("off")
        key.legend(handles=lines_of(looks_of(list(scenarios))), loc="upper left", fontsize=9, labelspacing=0.8)
        key.text(0.02, 0.45, f"{note}\nTiles: {TILE:g} m.", va="top", wrap=True, transform=key.transAxes)
        for axes, names in drawn:
            label_points(figure, axes, names)


def way(scenario: Scenario) -> tuple[Floats, Moment]:
    """Which way (K, d) does a script lead, and where is everything when it is most telling?

    No further than to where brakes hold. Most telling is when it first gets there, or else where it is farthest
    from where it began.
    """
    times = np.linspace(0.0, scenario.seconds, INSTANTS)
    moments = [scripted(scenario, float(time)) for time in times]
    way, stopped = [], []
    for time, moment in zip(times, moments, strict=True):
        held = moment.held
        for phase in scenario.active_phases(float(time)):
            if phase.hold is not None:
                wall = phase.hold.wall(held - origin_of(scenario, moment))
                held = held - min(wall.distance, 0.0) * np.asarray(wall.normal)
        way.append(held)
        stopped.append(float(np.linalg.norm(held - moment.held)) > PRESSED)
    places = np.array(way)
    far = np.round(np.linalg.norm(places - places[0], axis=1), 3)  # of equals the first, whatever the last digits
    best = int(np.argmax(stopped if any(stopped) else far))
    return places, replace(moments[best], held=places[best])
