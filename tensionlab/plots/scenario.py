"""Figure of a scenario that was played."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.errors import InputError
from tensionlab.plots import scene, style
from tensionlab.plots.scene import TILE_M, Moment
from tensionlab.plots.style import COARSE_SHADE, Entry
from tensionlab.scenarios.fidelity import ForceRecord, desired_force, rendered_force
from tensionlab.scenarios.scenery import scenery
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import AXIS_COLOURS, BLUE, GREY, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from tensionlab.scenarios.play import ScenarioResult

CURVE_HEIGHT, LAYOUT_HEIGHT = 2.0, 5.6  # smallest height of a panel of a curve, and of the layout, in inches
MIN_FORCE_SHARE = 0.1  # an axis is drawn if its force gets to this share of the largest
KNEE = 1.3  # multiple of the motors' largest tension beyond which forces are drawn on a logarithmic scale
SETTLING_S = 0.3  # after a phase's begin: forces of modules that start, or of what was before
NEAR_M = 0.12  # largest distance from a surface at which its force is drawn
SHADES = {
    "brake commanded": ("#A8D8C8", 0.0, 1.0),
    "module-local spring or vibration": ("#CC79A7", 0.0, 0.06),
}  # colours of what a module did besides pulling, and the heights of their shades as shares of the panel
WIDE: dict[str, Any] = {"linewidth": 5.0, "alpha": 0.3}
THIN: dict[str, Any] = {"linewidth": 1.2}


def plot_scenario(played: ScenarioResult) -> Figure:
    """Draw a scenario that was ``played``, by `tensionlab.scenarios.play.play`.

    On the left its layout, at the moment of the largest force, and force against distance where that makes sense.
    On the right, over time: its phases, the desired and the rendered force, and the tension of each module, with
    its brake and module-local effects. `InputError` if nothing was played.
    """
    run, scenario = played.run, played.scenario
    if not len(run):
        raise InputError(f'nothing of scenario "{scenario.name}" was played; there is nothing to draw')
    last, phases = float(run.time[-1]), scenario.phases
    heights = [0.1 + 0.25 * len(phases), 2.7, *([1.0] * run.rig.m)]
    height = max(6.8, 1.0 + 1.25 * sum(heights))
    with style.new_figure((14.0, height + 0.4)) as figure:
        figure.suptitle(f"{scenario.title}. {scenario.about}", fontweight="bold", x=0.01, ha="left")
        parts: Any = figure.subfigures(1, 2, width_ratios=[1.0, 1.45])
        left, right = parts
        panels = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        begins = np.array([phase.begin for phase in phases])
        ends = np.minimum([phase.end for phase in phases], last)
        panels[0].barh(range(len(phases)), np.maximum(ends - begins, 0.0), 0.84, begins, color="#C4D5E6")
        panels[0].set_title("Phases")
        panels[0].set_yticks(range(len(phases)), [phase.name for phase in phases])
        panels[0].tick_params(length=0, labelsize=8)
        panels[0].set_ylim(len(phases) - 0.5, -0.5)
        panels[0].spines[["left", "bottom"]].set_visible(False)
        draw_force(panels[1], played)
        for index, axes in enumerate(panels[2:]):
            draw_tension(axes, played, index)
        panels[-1].set_xlim(0.0, max(last, 1e-3))
        panels[-1].set_xlabel("time (s)")
        _draw_left(figure, left, played, height)
    return figure


def _draw_left(figure: Figure, left: SubFigure, played: ScenarioResult, height: float) -> None:
    """Draw the layout and, below, force against distance; the height is in inches."""
    rendered, curves = rendered_force(played), force_distance(played)
    columns = min(len(curves), 2)
    below = max(CURVE_HEIGHT * -(-len(curves) // columns), height - LAYOUT_HEIGHT) if curves else 0.0
    ratios = [height - below, below] if curves else [height]
    parts: Any = left.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    axes = parts[0].subplots()
    time = float(rendered.time[np.argmax(np.linalg.norm(rendered.force, axis=1))])
    path = played.run.position if played.person is None else played.person.position
    names = scene.draw_scene(axes, played.scenario, moment_of(played, time), path)
    axes.set_anchor("N")
    axes.set_title(f"Layout to scale, at {time:.2f} s; tiles of {TILE_M:g} m")
    style.add_legend(parts[0], 3, scene.scene_legend([played.scenario]))
    if curves:
        parts[1].suptitle("Force against distance", fontweight="bold", fontsize="medium", x=0.03, ha="left")
        panels = parts[1].subplots(-(-len(curves) // columns), columns, squeeze=False).ravel()
        for panel in panels[len(curves) :]:
            panel.axis("off")
        for panel, curve in zip(panels, curves, strict=False):
            panel.plot(*curve.desired, color=BLUE, **WIDE)
            panel.plot(*curve.rendered, color=BLUE, **THIN)
            panel.grid()
            style.two_scales(panel, np.concatenate([curve.desired[1], curve.rendered[1]]), knee_of(played))
            panel.set(xlabel=curve.distance, ylabel="force (N)", title=curve.title)
    style.label_points(figure, axes, names)


def moment_of(played: ScenarioResult, time: float) -> Moment:
    """Return where everything was, by the cycle that is nearest to a time."""
    run, rig = played.run, played.run.rig
    cycle = int(np.argmin(np.abs(run.time - time)))
    pairs = zip(rig.modules, run.anchors[cycle], strict=True)
    bodies = {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}
    return Moment(run.position[cycle], run.anchors[cycle], bodies)


def knee_of(played: ScenarioResult) -> float:
    """Return the force, in N, beyond which the scale is logarithmic: above what motors pulled with, or one can."""
    motors = np.linalg.norm(rendered_force(replace(played, person=None)).force, axis=1)
    return KNEE * max(float(motors.max()), *played.run.setup.upper)


def draw_force(axes: Axes, played: ScenarioResult) -> None:
    """Draw the desired force, wide and pale, and the rendered or measured one, along each axis that matters."""
    run, rendered = played.run, rendered_force(played)
    sizes = np.abs(rendered.force).max(axis=0)
    shown = [axis for axis in range(run.rig.dimension) if sizes[axis] >= max(MIN_FORCE_SHARE * sizes.max(), 1e-9)]
    for axis in shown:
        axes.plot(run.time, desired_force(run)[:, axis], color=AXIS_COLOURS["xyz"[axis]], **WIDE)
        axes.plot(rendered.time, rendered.force[:, axis], color=AXIS_COLOURS["xyz"[axis]], **THIN)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
    axes.set_ylabel("N")
    axes.set_title(f"Force on the {scenery(played.scenario).held_name(run.rig)}" if shown else "Force")
    two = style.two_scales(axes, rendered.force[:, shown], knee_of(played))
    axes.grid()
    up = run.rig.vertical
    source = "rendered (simulated)" if played.person is not None else "measured by the modules"
    entries: list[Entry] = [
        *(
            (f"along {'xyz'[axis]}" + ", up" * ("xyz"[axis] == up), {"color": AXIS_COLOURS["xyz"[axis]]})
            for axis in shown
        ),
        ("desired", {"color": GREY, **WIDE}),
        (source, {"color": GREY, **THIN}),
    ]
    style.legend_beside(axes, entries + [("logarithmic scale", {"color": COARSE_SHADE, "linewidth": 8.0})] * two)


def draw_tension(axes: Axes, played: ScenarioResult, index: int) -> None:
    """Draw the commanded and measured tension of a module and, with a simulated person, the cable's actual one.

    Shades show when its brake was commanded, and when the module rendered an effect itself.
    """
    run, person = played.run, played.person
    lower, upper = run.setup.lower[index], run.setup.upper[index]
    for limit in (lower, upper):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9, zorder=1)
    lines = [
        ("commanded", run.time, run.commanded, {"color": BLUE, **WIDE}),
        ("motor, measured", run.time, run.measured, {"color": ORANGE, **THIN}),
    ]
    if person is not None:
        lines.append(("cable, simulated", person.time, person.tensions, {"color": RED, **THIN}))
    for _, time, tensions, look in lines:
        axes.plot(time, tensions[:, index], **look)
    axes.set_ylabel("N")
    axes.set_title(f"Tension of {run.rig.modules[index].name}")
    # One range for all modules, so that they compare.
    style.two_scales(axes, np.append(lines[-1][2], 1.1 * upper), KNEE * max(run.setup.upper))
    axes.grid()
    entries: list[Entry] = [(name, look) for name, _, _, look in lines]
    entries.append(("motor limits", {"color": GREY, "linestyle": "--", "linewidth": 0.9}))
    across = axes.get_xaxis_transform()  # heights as shares of the panel
    local = np.isfinite(run.impedances[:, index]).any(axis=1)
    states = (run.commanded_brakes[:, index], local)
    for (name, (colour, low, high)), on in zip(SHADES.items(), states, strict=True):
        if on.any():
            axes.fill_between(
                run.time, low, high, on, step="post", color=colour, linewidth=0.0, zorder=0, transform=across
            )
            entries.append((name, {"color": colour, "linewidth": 6}))
    if index == 0 or len(entries) > len(lines) + 1:
        style.legend_beside(axes, entries if index == 0 else entries[len(lines) + 1 :])


class ForceDistance(NamedTuple):
    """Force in N against distance in m, or mm above a surface, in a phase: desired and rendered, (2, K) each."""

    title: str
    distance: str
    desired: Floats
    rendered: Floats


def force_distance(played: ScenarioResult) -> list[ForceDistance]:
    """Return force against distance for the phases of which it says more than time does.

    Those with a flat surface that pushes or pulls: the force out of it, against the height above it. And those of
    a scenario whose origin is on a body, as a bow: the pull towards it, against the distance from it.
    """
    scenario = played.scenario
    measured = rendered_force(replace(played, person=None))
    desired = ForceRecord(played.run.time, measured.position, desired_force(played.run))
    charts = []
    for phase in scenario.phases:
        parts: list[Any] = [
            part for effect in phase.effects.values() for part in (effect, getattr(effect, "wall", None))
        ]
        plane = next((part.plane for part in parts if hasattr(part, "plane")), None)
        name = "height above the surface (mm)"
        if plane is None:
            if scenario.frame is None or not phase.effects:
                continue
            origin = scenario.labels.get(scenario.frame, scenario.frame)
            name = f"from {origin} to {scenery(scenario).held_name(played.run.rig)} (m)"
        curves = []
        for whole in (desired, rendered_force(played)):
            part = whole.during(phase.begin + SETTLING_S, phase.end)
            if plane is None:
                distance = np.linalg.norm(part.position, axis=1)
                towards = -part.position / np.where(distance > 0.0, distance, 1.0)[:, None]
                curves.append(np.stack([distance, np.einsum("kd,kd->k", part.force, towards)]))
            else:
                height = plane.height(part.position)
                near = np.abs(height) <= NEAR_M
                curves.append(np.stack([1e3 * height[near], part.force[near] @ plane.n]))
        charts.append(ForceDistance(phase.name, name, *curves))
    return charts
