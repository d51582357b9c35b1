"""A scenario that was played: where everything was, what was meant and felt, and whether that is right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import ShapeError
from tensionlab.plots.check_table import Judged, draw_verdicts
from tensionlab.plots.force_distance import against, draw_against
from tensionlab.plots.labels import label_points
from tensionlab.plots.run import COLOURS
from tensionlab.plots.scale import SHADE, two_scales
from tensionlab.plots.scene import TILE, Moment, draw_scene, held_name, looks_of
from tensionlab.plots.style import BLUE, GREY, ORANGE, RED, add_legend, legend_beside, new_figure
from tensionlab.plots.timeline import draw_ribbons, ribbons
from tensionlab.scenarios.expected_values import rendered_force

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from tensionlab.scenarios import Phase
    from tensionlab.scenarios.play import ScenarioResult

MATTERS = 0.1
"""An axis is drawn if its force gets to this share of the largest."""
SHADES = ("#DCE6F0", "#C4D5E6")
"""Of the phases, in turn."""
PANEL, LAYOUT = 2.0, 5.6
"""Least height of a panel of force against distance, and of the layout above it, in inches."""
KNEE = 1.3
"""Beyond so many times the motors' largest tension, forces are drawn on a smaller scale."""


def plot_scenario(played: ScenarioResult, rows: Sequence[Judged], path: str | Path) -> None:
    """Draw a scenario that was played.

    On the left its layout, at the moment of the largest force, and force against distance where that makes sense.
    On the right, over time: its phases, the force meant and felt, the tension of each module, what brakes did and
    what modules rendered by themselves. Below, what it was to feel like.

    Parameters
    ----------
    played : ScenarioResult
    rows : sequence of Check
        Of the table of expected feel; may be empty.
    path : path
        The suffix chooses the format: png, pdf or svg.

    Raises
    ------
    ShapeError
        If the suffix is no such format, or nothing was played.
    """
    run, scenario = played.run, played.scenario
    if not len(run):
        raise ShapeError(f'nothing of scenario "{scenario.name}" was played; there is nothing to draw')
    strips = ribbons(played)
    lanes = _lanes(scenario.phases)
    heights = [0.1 + 0.3 * len(lanes), 2.7, *([1.0] * run.rig.m), *([0.1 + 0.25 * len(strips)] if strips else [])]
    upper = max(6.8, 1.0 + 1.25 * sum(heights))
    lower = 0.5 + 0.27 * (len(rows) + 1) if rows else 0.0
    with new_figure(path, (14.0, upper + lower + 0.4)) as figure:
        figure.suptitle(f"{scenario.title}. {scenario.about}", fontweight="bold", x=0.01, ha="left")
        ratios = [upper, lower] if rows else [upper]
        parts: Any = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
        left, right = parts[0].subfigures(1, 2, width_ratios=[1.0, 1.45])
        panels = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        _draw_phases(panels[0], lanes, float(run.time[-1]))
        draw_force(panels[1], played)
        for index in range(run.rig.m):
            draw_tension(panels[2 + index], played, index)
        if strips:
            draw_ribbons(panels[-1], played, strips)
        for axes in panels:
            axes.set_xlim(0.0, max(run.time[-1], 1e-3))
        panels[-1].set_xlabel("time (s)")
        if rows:
            draw_verdicts(parts[1].subplots(), rows)
        _draw_left(figure, left, played, upper)


def knee_of(played: ScenarioResult) -> float:
    """Beyond which force, in N, is a smaller scale due? Beyond what motors pulled with, or one of them can."""
    motors = np.linalg.norm(rendered_force(replace(played, person=None)).force, axis=1)
    return KNEE * max(float(motors.max()), *played.run.setup.upper)


def moment_of(played: ScenarioResult, time: float) -> Moment:
    """Where was everything, as the lengths and directions of the cables tell?"""
    run, rig = played.run, played.run.rig
    cycle = int(np.argmin(np.abs(run.time - time)))
    held = run.position[cycle]
    anchors = held + (run.structure[cycle] * run.lengths[cycle]).T
    fixed = np.array([module.frame not in rig.frames for module in rig.modules])
    anchors[fixed] = rig.anchors[fixed]
    pairs = zip(rig.modules, anchors, strict=True)
    bodies = {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}
    return Moment(held, anchors, bodies)


def _draw_left(figure: Figure, left: SubFigure, played: ScenarioResult, height: float) -> None:
    """Draw the layout and, below, force against distance; the height is in inches."""
    felt, curves = rendered_force(played), against(played)
    columns = min(len(curves), 2)
    below = max(PANEL * -(-len(curves) // columns), height - LAYOUT) if curves else 0.0
    ratios = [height - below, below] if curves else [height]
    parts: Any = left.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    axes = parts[0].subplots()
    latest = float(felt.time[np.argmax(np.linalg.norm(felt.force, axis=1))])
    path = played.run.position if played.person is None else played.person.position
    names = draw_scene(axes, played.scenario, moment_of(played, latest), path)
    axes.set_anchor("N")
    axes.set_title(f"Layout to scale, at {latest:.2f} s; tiles of {TILE:g} m")
    add_legend(parts[0], 3, looks_of([played.scenario]))
    if curves:
        parts[1].suptitle("Force against distance", fontweight="bold", fontsize="medium", x=0.03, ha="left")
        panels = parts[1].subplots(-(-len(curves) // columns), columns, squeeze=False).ravel()
        for panel, each in zip(panels, curves, strict=False):
            draw_against(panel, each, knee_of(played))
        for panel in panels[len(curves) :]:
            panel.axis("off")
    label_points(figure, axes, names)


def _lanes(phases: Iterable[Phase]) -> list[list[Phase]]:
    """In which lanes do phases not overlap?"""
    lanes: list[list[Phase]] = []
    for phase in sorted(phases, key=lambda each: each.begin):
        free = next((lane for lane in lanes if lane[-1].end <= phase.begin + 1e-9), None)
        if free is None:
            lanes.append([phase])
        else:
            free.append(phase)
    return lanes


def _draw_phases(axes: Axes, lanes: list[list[Phase]], last: float) -> None:
    """Draw phases as bars with their names, up to the last time."""
    for row, lane in enumerate(lanes):
        for number, phase in enumerate(lane):
            if (length := min(phase.end, last) - phase.begin) > 0.0:
                axes.barh(row, length, 0.84, phase.begin, color=SHADES[(row + number) % 2])
                axes.text(phase.begin + length / 2, row, phase.name, ha="center", va="center", fontsize=8.5)
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    axes.set_yticks([])
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(axis="x", length=0)
    axes.set_title("What is rendered")


def draw_force(axes: Axes, played: ScenarioResult) -> None:
    """Draw the force meant, wide and pale, and the one felt, along each axis that matters."""
    run, felt = played.run, rendered_force(played)
    sizes = np.abs(felt.force).max(axis=0)
    shown = [axis for axis in range(run.rig.dimension) if sizes[axis] >= max(MATTERS * sizes.max(), 1e-9)]
    for axis in shown:
        axes.plot(run.time, run.desired[:, axis], color=COLOURS[axis], linewidth=5.0, alpha=0.3)
        axes.plot(felt.time, felt.force[:, axis], color=COLOURS[axis], linewidth=1.2)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
    axes.set_ylabel("N")
    who = "really felt" if played.person is not None else "told by the modules"
    axes.set_title(f"Force on the {held_name(played.scenario)}" if shown != [] else "Force")
    two = two_scales(axes, felt.force[:, shown], knee_of(played))
    axes.grid()
    letters = [(_axis(run.rig.vertical, "xyz"[axis]), {"color": COLOURS[axis]}) for axis in shown]
    pale: dict[str, Any] = {"color": GREY, "linewidth": 5.0, "alpha": 0.35}
    entries = [*letters, ("intended", pale), (who, {"color": GREY, "linewidth": 1.2})]
    if two:
        entries.append(("smaller scale", {"color": SHADE, "linewidth": 8.0}))
    legend_beside(axes, entries)


def _axis(up: str, letter: str) -> str:
    return f"along {letter}, up" if letter == up else f"along {letter}"


def draw_tension(axes: Axes, played: ScenarioResult, index: int) -> None:
    """Draw what a module was told, says and, where a simulated person knows, really pulls with."""
    run, felt = played.run, played.person
    lower, upper = run.setup.lower[index], run.setup.upper[index]
    for limit in (lower, upper):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9, zorder=1)
    axes.plot(run.time, run.commanded[:, index], color=BLUE, linewidth=5.0, alpha=0.3)
    axes.plot(run.time, run.measured[:, index], color=ORANGE, linewidth=1.2)
    entries: list[tuple[str, dict[str, Any]]] = [
        ("set-point", {"color": BLUE, "linewidth": 5.0, "alpha": 0.3}),
        ("motor, as told", {"color": ORANGE, "linewidth": 1.2}),
    ]
    if felt is not None:
        axes.plot(felt.time, felt.tensions[:, index], color=RED, linewidth=1.2)
        entries.append(("cable, really", {"color": RED, "linewidth": 1.2}))
    entries.append(("limits of the motor", {"color": GREY, "linestyle": "--", "linewidth": 0.9}))
    axes.set_ylabel("N")
    axes.set_title(f"Tension of {run.rig.modules[index].name}")
    pulled = run.measured if felt is None else felt.tensions  # one range for all, so that they compare
    two_scales(axes, np.append(pulled, 1.1 * upper), KNEE * max(run.setup.upper))
    axes.grid()
    if index == 0:
        legend_beside(axes, entries)
