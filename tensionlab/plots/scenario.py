"""Figures of scenarios: one that was played, and the layouts of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import InputError
from tensionlab.plots import scenario_panels as panels_of
from tensionlab.plots.scene import TILE_M, Moment, draw_scene, origin_of, scene_legend, scripted_moment
from tensionlab.plots.style import add_legend, label_points, lines_of, new_figure
from tensionlab.scenarios.checks import rendered_force

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from tensionlab.arrays import Floats
    from tensionlab.scenarios import Scenario
    from tensionlab.scenarios.checks import Check
    from tensionlab.scenarios.play import ScenarioResult

CURVE_HEIGHT, LAYOUT_HEIGHT = 2.0, 5.6
"""Minimum height of a panel of force against distance, and of the layout above it, in inches."""
LAYOUT_COLUMNS = 3
LAYOUTS_WIDTH = 13.0
"""Of the figure of layouts, in inches."""
MARGIN_M = 0.12
"""Around each layout."""
MIN_CELL_M = 1.0
"""Of a column's width and a row's height: room for the legend."""
PRESSING_M = 0.002
"""A script that leads so far beyond where brakes hold presses against them."""
SCRIPT_SAMPLES = 201


def plot_scenario(played: ScenarioResult, rows: Sequence[Check]) -> Figure:
    """Draw a scenario that was played.

    On the left its layout, at the moment of the largest force, and force against distance where that makes sense.
    On the right, over time: its phases, the desired and the rendered force, the tension of each module, brakes and
    module-local effects. Below, the table of expected values, if there is one.

    Raises
    ------
    InputError
        If nothing was played.
    """
    run, scenario = played.run, played.scenario
    if not len(run):
        raise InputError(f'nothing of scenario "{scenario.name}" was played; there is nothing to draw')
    bars, lanes = panels_of.timeline(played), panels_of.lanes_of(scenario.phases)
    heights = [0.1 + 0.3 * len(lanes), 2.7, *([1.0] * run.rig.m), *([0.1 + 0.25 * len(bars)] if bars else [])]
    upper = max(6.8, 1.0 + 1.25 * sum(heights))
    lower = 0.5 + 0.27 * (len(rows) + 1) if rows else 0.0
    with new_figure((14.0, upper + lower + 0.4)) as figure:
        figure.suptitle(f"{scenario.title}. {scenario.about}", fontweight="bold", x=0.01, ha="left")
        ratios = [upper, lower] if rows else [upper]
        parts: Any = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
        left, right = parts[0].subfigures(1, 2, width_ratios=[1.0, 1.45])
        panels = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        panels_of.draw_phases(panels[0], lanes, float(run.time[-1]))
        panels_of.draw_force(panels[1], played)
        for index in range(run.rig.m):
            panels_of.draw_tension(panels[2 + index], played, index)
        if bars:
            panels_of.draw_timeline(panels[-1], played, bars)
        for axes in panels:
            axes.set_xlim(0.0, max(run.time[-1], 1e-3))
        panels[-1].set_xlabel("time (s)")
        if rows:
            panels_of.draw_check_table(parts[1].subplots(), rows)
        _draw_left(figure, left, played, upper)
    return figure


def _draw_left(figure: Figure, left: SubFigure, played: ScenarioResult, height: float) -> None:
    """Draw the layout and, below, force against distance; the height is in inches."""
    rendered, curves = rendered_force(played), panels_of.force_distance(played)
    columns = min(len(curves), 2)
    below = max(CURVE_HEIGHT * -(-len(curves) // columns), height - LAYOUT_HEIGHT) if curves else 0.0
    ratios = [height - below, below] if curves else [height]
    parts: Any = left.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    axes = parts[0].subplots()
    time = float(rendered.time[np.argmax(np.linalg.norm(rendered.force, axis=1))])
    path = played.run.position if played.person is None else played.person.position
    names = draw_scene(axes, played.scenario, moment_of(played, time), path)
    axes.set_anchor("N")
    axes.set_title(f"Layout to scale, at {time:.2f} s; tiles of {TILE_M:g} m")
    add_legend(parts[0], 3, scene_legend([played.scenario]))
    if curves:
        parts[1].suptitle("Force against distance", fontweight="bold", fontsize="medium", x=0.03, ha="left")
        panels = parts[1].subplots(-(-len(curves) // columns), columns, squeeze=False).ravel()
        for panel, each in zip(panels, curves, strict=False):
            panels_of.draw_force_distance(panel, each, panels_of.knee_of(played))
        for panel in panels[len(curves) :]:
            panel.axis("off")
    label_points(figure, axes, names)


def moment_of(played: ScenarioResult, time: float) -> Moment:
    """Return where everything was, from the measured lengths and directions of the cables."""
    run, rig = played.run, played.run.rig
    cycle = int(np.argmin(np.abs(run.time - time)))
    held = run.position[cycle]
    anchors = held + (run.structure[cycle] * run.lengths[cycle]).T
    fixed = np.array([module.frame not in rig.frames for module in rig.modules])
    anchors[fixed] = rig.anchors[fixed]
    pairs = zip(rig.modules, anchors, strict=True)
    bodies = {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}
    return Moment(held, anchors, bodies)


def plot_scenario_layouts(scenarios: Sequence[Scenario], note: str) -> Figure:
    """Draw where modules stand in the room and on the body, with the hand or the head where its script leads it.

    All layouts have one scale; the note stands beside the legend.
    """
    rows = -(-(len(scenarios) + 1) // LAYOUT_COLUMNS)  # one more place, for the legend
    with new_figure((LAYOUTS_WIDTH, 1.0)) as figure:
        grid: Any = figure.add_gridspec(rows, LAYOUT_COLUMNS)
        drawn = []
        for number, scenario in enumerate(scenarios):
            axes: Any = figure.add_subplot(grid[number // LAYOUT_COLUMNS, number % LAYOUT_COLUMNS])
            path, moment = script_path(scenario)
            drawn.append((axes, draw_scene(axes, scenario, moment, path)))
            axes.set_title(scenario.title)
        boxes = np.array([axes.dataLim.get_points() for axes, _ in drawn])
        # One scale for all: all of a column are as wide as the widest, all of a row as high as the highest.
        spans = boxes[:, 1] - boxes[:, 0] + 2 * MARGIN_M
        widths = [spans[column::LAYOUT_COLUMNS, 0].max(initial=MIN_CELL_M) for column in range(LAYOUT_COLUMNS)]
        ends = [slice(LAYOUT_COLUMNS * row, LAYOUT_COLUMNS * (row + 1)) for row in range(rows)]
        heights = [spans[end, 1].max(initial=MIN_CELL_M) for end in ends]
        grid.set_width_ratios(widths)
        grid.set_height_ratios(heights)
        figure.set_size_inches(LAYOUTS_WIDTH, LAYOUTS_WIDTH * sum(heights) / sum(widths) + 0.35 * rows)
        for number, (axes, _) in enumerate(drawn):
            middle, bottom = boxes[number, :, 0].mean(), boxes[number, 0, 1] - MARGIN_M
            axes.set_xlim(middle + np.array([-0.5, 0.5]) * widths[number % LAYOUT_COLUMNS])
            axes.set_ylim(bottom, bottom + heights[number // LAYOUT_COLUMNS])
        key: Any = figure.add_subplot(grid[-1, -1])
        key.axis("off")
        key.legend(handles=lines_of(scene_legend(scenarios)), loc="upper left", fontsize=9, labelspacing=0.8)
        key.text(0.02, 0.45, f"{note}\nTiles: {TILE_M:g} m.", va="top", wrap=True, transform=key.transAxes)
        for axes, names in drawn:
            label_points(figure, axes, names)
    return figure


def script_path(scenario: Scenario) -> tuple[Floats, Moment]:
    """Return the path (K, d) on which a script leads, no further than brakes hold, and the moment that shows most.

    That is when it first gets to a brake, or else when it is farthest from where it began.
    """
    times = np.linspace(0.0, scenario.seconds, SCRIPT_SAMPLES)
    moments = [scripted_moment(scenario, float(time)) for time in times]
    path, stopped = [], []
    for time, moment in zip(times, moments, strict=True):
        held = moment.held
        for phase in scenario.active_phases(float(time)):
            if phase.hold is not None:
                wall = phase.hold.wall(held - origin_of(scenario, moment))
                held = held - min(wall.distance, 0.0) * np.asarray(wall.normal)
        path.append(held)
        stopped.append(float(np.linalg.norm(held - moment.held)) > PRESSING_M)
    places = np.array(path)
    far = np.round(np.linalg.norm(places - places[0], axis=1), 3)  # of equals the first, whatever the last digits
    best = int(np.argmax(stopped if any(stopped) else far))
    return places, moments[best]._replace(held=places[best])
