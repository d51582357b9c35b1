"""Figure of where modules stand in several scenarios, to one scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensionlab.plots import scene, style
from tensionlab.plots.scene import TILE_M, Moment
from tensionlab.scenarios import Scenario
from tensionlab.support.arrays import Floats

COLUMNS, ROW_HEIGHT = 3, 2.9  # panels in a row, and its height in inches
NARROWEST_M = 2.6  # smallest width of a panel, for its title
PRESSING_M = 0.002  # distance beyond a brake's wall at which a script presses against it
SCRIPT_SAMPLES = 201


def plot_scenario_layouts(scenarios: Sequence[Scenario], note: str) -> Any:
    """Draw where modules stand in the room and on the body, with the hand or the head where its script leads it.

    All layouts have one scale; the note is above them.

    Parameters
    ----------
    scenarios : sequence of Scenario
        One a panel.
    note : str
        Above the layouts.
    """
    rows = [scenarios[start : start + COLUMNS] for start in range(0, len(scenarios), COLUMNS)]
    with style.new_figure((11.0, 0.9 + ROW_HEIGHT * len(rows))) as figure:
        figure.suptitle(f"{note} Tiles: {TILE_M:g} m.", fontsize="small")
        parts: Any = figure.subfigures(len(rows), 1, squeeze=False)[:, 0]
        drawn = [_draw_row(part, row) for part, row in zip(parts, rows, strict=True)]
        style.add_legend(figure, 7, scene.scene_legend(scenarios))
        ends = [axes.get_ylim() for row in drawn for axes, _ in row]
        for axes, names in (panel for row in drawn for panel in row):
            axes.set_ylim(min(ends)[0], max(high for _, high in ends))
            style.label_points(figure, axes, names)
    return figure


def _draw_row(part: Any, scenarios: Sequence[Scenario]) -> list[tuple[Any, dict[str, list[tuple[float, float]]]]]:
    """Draw scenarios side by side, each as wide as it needs; return the panels with the names of their points."""
    panels: Any = part.subplots(1, len(scenarios), squeeze=False)[0]
    drawn = []
    for axes, scenario in zip(panels, scenarios, strict=True):
        path, moment = script_path(scenario)
        drawn.append((axes, scene.draw_scene(axes, scenario, moment, path)))
        worn = sum(module.frame in scenario.rig.frames for module in scenario.rig.modules)
        axes.set_title(f"{scenario.title}\n{scenario.rig.m - worn} in the room, {worn} on the body")
    panels[0].get_gridspec().set_width_ratios([max(NARROWEST_M, np.ptp(axes.get_xlim())) for axes in panels])
    return drawn


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
                wall = phase.hold.wall(held - scene.origin_of(scenario, moment))
                held = held - min(wall.distance, 0.0) * np.asarray(wall.normal)
        path.append(held)
        stopped.append(float(np.linalg.norm(held - moment.held)) > PRESSING_M)
    places = np.array(path)
    far = np.round(np.linalg.norm(places - places[0], axis=1), 3)  # of equals the first, whatever the last digits
    best = int(np.argmax(stopped if any(stopped) else far))
    return places, moments[best]._replace(held=places[best])


def scripted_moment(scenario: Scenario, time: float) -> Moment:
    """Return where the script has everything at a time."""
    bodies = {name: script.position(time) for name, script in scenario.person.bodies.items()}
    nowhere = np.zeros(scenario.rig.dimension)
    anchors = np.array([module.anchor + bodies.get(module.frame, nowhere) for module in scenario.rig.modules])
    return Moment(scenario.person.script.position(time), anchors, bodies)
