"""Figure of where modules stand in several scenarios, to one scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensionlab.plots import scene, style
from tensionlab.plots.scene import TILE_M, Moment
from tensionlab.scenarios import Scenario
from tensionlab.support.arrays import Floats

COLUMNS = 3
PRESSING_M = 0.002  # distance beyond a brake's wall at which a script presses against it
SCRIPT_SAMPLES = 201


def plot_scenario_layouts(scenarios: Sequence[Scenario], note: str) -> Any:
    """Draw where modules stand in the room and on the body, with the hand or the head where its script leads it.

    All layouts have one scale; the note stands beside the legend.

    Parameters
    ----------
    scenarios : sequence of Scenario
        One a panel.
    note : str
        Beside the legend.
    """
    rows = -(-(len(scenarios) + 1) // COLUMNS)  # one more place, for the legend
    with style.new_figure((15.0, 3.7 * rows)) as figure:
        panels: Any = figure.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False)
        drawn = []
        for axes, scenario in zip(panels.flat, scenarios, strict=False):
            path, moment = script_path(scenario)
            drawn.append((axes, scene.draw_scene(axes, scenario, moment, path)))
            axes.set_title(scenario.title)
        for axes in panels.flat[len(scenarios) :]:
            axes.axis("off")
        key = panels[-1, -1]
        key.legend(
            handles=style.lines_of(scene.scene_legend(scenarios)), loc="upper left", fontsize=9, labelspacing=0.8
        )
        key.text(0.02, 0.45, f"{note}\nTiles: {TILE_M:g} m.", va="top", wrap=True, transform=key.transAxes)
        for axes, names in drawn:
            style.label_points(figure, axes, names)
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
