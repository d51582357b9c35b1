"""Figure of a scenario that was played."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.plots import scene, style
from tensionlab.plots.run import COLOURS
from tensionlab.plots.scene import TILE_M, Moment
from tensionlab.plots.style import COARSE_SHADE, Entry
from tensionlab.scenarios.checks import ForceRecord, desired_force, rendered_force
from tensionlab.scenarios.expected import check_scenario
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from tensionlab.scenarios import Phase
    from tensionlab.scenarios.checks import Check
    from tensionlab.scenarios.play import ScenarioResult

# Minimum height of a panel of force against distance, and of the layout above it, in inches.
CURVE_HEIGHT, LAYOUT_HEIGHT = 2.0, 5.6
MIN_FORCE_SHARE = 0.1  # an axis is drawn if its force gets to this share of the largest
KNEE = 1.3  # multiple of the motors' largest tension beyond which forces are drawn on a logarithmic scale
# Within so long of a phase's begin, forces are those of modules that start, or of what was before.
SETTLING_S = 0.3
NEAR_M = 0.12  # largest distance from a surface at which its force is drawn
PAWL_FORCE_N = 1.0  # a pawl holds where the cable pulls by so much harder than its motor ..
PAWL_RELEASE_S = 0.3  # ... and for so long after its brake was commanded.
TIMELINE_LOOKS = {
    "brake": ("brake commanded", "#A8D8C8"),
    "pawl": ("pawl holds the cable", GREEN),
    "local": ("module-local spring or vibration", "#CC79A7"),
}  # words and colours of the bars of a timeline
EXPECTED_X, MEASURED_X, SUMMARY_X = 0.60, 0.78, 0.84  # places in the table of checks, as shares of the width
WIDE: dict[str, Any] = {"linewidth": 5.0, "alpha": 0.3}
THIN: dict[str, Any] = {"linewidth": 1.2}


def plot_scenario(played: ScenarioResult, rows: Sequence[Check] | None = None) -> Figure:
    """Draw a scenario that was played.

    On the left its layout, at the moment of the largest force, and force against distance where that makes sense.
    On the right, over time: its phases, the desired and the rendered force, the tension of each module, brakes and
    module-local effects. Below, the table of expected values, if there is one: these rows, or those of
    `check_scenario`. `InputError` if nothing was played.

    Parameters
    ----------
    played : ScenarioResult
        From `tensionlab.scenarios.play.play`.
    rows : sequence of Check, optional
        The table; left out: that of `check_scenario`.

    Examples
    --------
    >>> from tensionlab import plots
    >>> from tensionlab.scenarios import load_scenario
    >>> from tensionlab.scenarios.play import play, simulate_modules
    >>> recoil = load_scenario("recoil")
    >>> figure = plots.plot_scenario(play(recoil, simulate_modules(recoil), seconds=0.5), ())
    """
    run, scenario = played.run, played.scenario
    if not len(run):
        raise InputError(f'nothing of scenario "{scenario.name}" was played; there is nothing to draw')
    if rows is None:
        rows = check_scenario(played)
    bars = timeline(played)
    heights = [
        0.1 + 0.25 * len(scenario.phases),
        2.7,
        *([1.0] * run.rig.m),
        *([0.1 + 0.25 * len(bars)] if bars else []),
    ]
    upper = max(6.8, 1.0 + 1.25 * sum(heights))
    lower = 0.5 + 0.27 * (len(rows) + 1) if rows else 0.0
    with style.new_figure((14.0, upper + lower + 0.4)) as figure:
        figure.suptitle(f"{scenario.title}. {scenario.about}", fontweight="bold", x=0.01, ha="left")
        ratios = [upper, lower] if rows else [upper]
        parts: Any = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
        left, right = parts[0].subfigures(1, 2, width_ratios=[1.0, 1.45])
        panels = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        draw_phases(panels[0], scenario.phases, float(run.time[-1]))
        draw_force(panels[1], played)
        for index in range(run.rig.m):
            draw_tension(panels[2 + index], played, index)
        if bars:
            draw_timeline(panels[-1], played, bars)
        for axes in panels:
            axes.set_xlim(0.0, max(run.time[-1], 1e-3))
        panels[-1].set_xlabel("time (s)")
        if rows:
            draw_check_table(parts[1].subplots(), rows)
        _draw_left(figure, left, played, upper)
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
        for panel, each in zip(panels, curves, strict=False):
            draw_force_distance(panel, each, knee_of(played))
        for panel in panels[len(curves) :]:
            panel.axis("off")
    style.label_points(figure, axes, names)


def moment_of(played: ScenarioResult, time: float) -> Moment:
    """Return where everything was."""
    run, rig = played.run, played.run.rig
    cycle = int(np.argmin(np.abs(run.time - time)))
    held = run.position[cycle]
    anchors = run.anchors[cycle]
    pairs = zip(rig.modules, anchors, strict=True)
    bodies = {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}
    return Moment(held, anchors, bodies)


def knee_of(played: ScenarioResult) -> float:
    """Return the force, in N, beyond which the scale is logarithmic: above what motors pulled with, or one can."""
    motors = np.linalg.norm(rendered_force(replace(played, person=None)).force, axis=1)
    return KNEE * max(float(motors.max()), *played.run.setup.upper)


def draw_phases(axes: Axes, phases: Sequence[Phase], last: float) -> None:
    """Draw a bar for each phase, up to the last time."""
    begins = np.array([phase.begin for phase in phases])
    ends = np.array([phase.end for phase in phases])
    axes.barh(range(len(phases)), np.maximum(np.minimum(ends, last) - begins, 0.0), 0.84, begins, color="#C4D5E6")
    axes.set_title("Phases")
    _name_rows(axes, [phase.name for phase in phases])
    axes.spines["bottom"].set_visible(False)
    axes.tick_params(axis="x", length=0)


def _name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Name rows of bars, from above."""
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.spines["left"].set_visible(False)


def draw_force(axes: Axes, played: ScenarioResult) -> None:
    """Draw the desired force, wide and pale, and the rendered or measured one, along each axis that matters."""
    run, rendered = played.run, rendered_force(played)
    sizes = np.abs(rendered.force).max(axis=0)
    shown = [axis for axis in range(run.rig.dimension) if sizes[axis] >= max(MIN_FORCE_SHARE * sizes.max(), 1e-9)]
    for axis in shown:
        axes.plot(run.time, desired_force(run)[:, axis], color=COLOURS[axis], **WIDE)
        axes.plot(rendered.time, rendered.force[:, axis], color=COLOURS[axis], **THIN)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
    axes.set_ylabel("N")
    axes.set_title(f"Force on the {scene.held_name(played.scenario)}" if shown else "Force")
    two = style.two_scales(axes, rendered.force[:, shown], knee_of(played))
    axes.grid()
    up = run.rig.vertical
    source = "rendered (simulated)" if played.person is not None else "measured by the modules"
    entries: list[Entry] = [
        *((f"along {'xyz'[axis]}" + ", up" * ("xyz"[axis] == up), {"color": COLOURS[axis]}) for axis in shown),
        ("desired", {"color": GREY, **WIDE}),
        (source, {"color": GREY, **THIN}),
    ]
    style.legend_beside(axes, entries + [("logarithmic scale", {"color": COARSE_SHADE, "linewidth": 8.0})] * two)


def draw_tension(axes: Axes, played: ScenarioResult, index: int) -> None:
    """Draw the commanded and measured tension of a module and, with a simulated person, the cable's actual one."""
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
    if index == 0:
        entries = [(name, look) for name, _, _, look in lines]
        style.legend_beside(
            axes, [*entries, ("motor limits", {"color": GREY, "linestyle": "--", "linewidth": 0.9})]
        )


class Curve(NamedTuple):
    """Force against distance, in N and m (mm above a surface), (K,) each."""

    distance: Floats
    force: Floats


class ForceDistance(NamedTuple):
    """Desired and rendered force against distance in a phase."""

    title: str
    distance: str
    desired: Curve
    rendered: Curve


def force_distance(played: ScenarioResult) -> list[ForceDistance]:
    """Return force against distance for the phases of which it says more than time does.

    Those with a flat surface that pushes or pulls: the force out of it, against the height above it. And those of
    a scenario whose origin is on a body, as a bow: the pull towards it, against the distance from it.
    """
    run, frame = played.run, played.scenario.frame
    rendered, measured = rendered_force(played), rendered_force(replace(played, person=None))
    desired = ForceRecord(run.time, measured.position, desired_force(run))
    between = f"from {played.scenario.labels.get(frame or '', frame)} to {scene.held_name(played.scenario)} (m)"
    found = []
    for phase in played.scenario.phases:
        plane = scene.plane_of(phase, ["plane"])
        if plane is None and (frame is None or not phase.effects):
            continue
        parts = [each.during(phase.begin + SETTLING_S, phase.end) for each in (desired, rendered)]
        name = between if plane is None else "height above the surface (mm)"
        found.append(ForceDistance(phase.name, name, *(_curve(part, plane) for part in parts)))
    return found


def draw_force_distance(axes: Axes, each: ForceDistance, knee: float) -> None:
    """Draw the desired force, wide and pale, and the rendered one."""
    axes.plot(*each.desired, color=BLUE, **WIDE)
    axes.plot(*each.rendered, color=BLUE, **THIN)
    axes.grid()
    style.two_scales(axes, np.concatenate([each.desired.force, each.rendered.force]), knee)
    axes.set(xlabel=each.distance, ylabel="force (N)", title=each.title)


def _curve(part: ForceRecord, plane: Any) -> Curve:
    arm, force = part.position, part.force
    if plane is None:
        distance = np.linalg.norm(arm, axis=1)
        towards = -arm / np.where(distance > 0.0, distance, 1.0)[:, None]
        return Curve(distance, np.einsum("kd,kd->k", force, towards))
    height = plane.height(arm)
    near = np.abs(height) <= NEAR_M
    return Curve(1e3 * height[near], force[near] @ plane.n)


class Bar(NamedTuple):
    """Cycles (K,) in which something was on, of the kinds in `TIMELINE_LOOKS`."""

    kind: str
    on: NDArray[np.bool_]


def timeline(played: ScenarioResult) -> dict[str, list[Bar]]:
    """Return the bars of brakes and of module-local effects by the name of their row; only rows that were on."""
    run, held = played.run, pawls_engaged(played)
    local: NDArray[np.bool_] = np.asarray(np.isfinite(run.impedances).any(axis=2))
    found = {}
    for index, module in enumerate(run.rig.modules):
        if run.commanded_brakes[:, index].any():
            bars = [Bar("brake", run.commanded_brakes[:, index]), Bar("pawl", held[:, index])]
            found[f"{module.name}, brake"] = bars
        if local[:, index].any():
            found[f"{module.name}, local impedance"] = [Bar("local", local[:, index])]
    return found


def draw_timeline(axes: Axes, played: ScenarioResult, rows: dict[str, list[Bar]]) -> None:
    """Draw a row for each, and a legend of its colours."""
    period = 1.0 / played.run.setup.rate
    used: dict[str, None] = {}
    for row, each in enumerate(rows.values()):
        axes.axhspan(row - 0.4, row + 0.4, color="#F1F1F1", zorder=0)
        for kind, on in each:
            if on.any():
                used[kind] = None
                edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
                begins, ends = played.run.time[edges[::2]], played.run.time[edges[1::2] - 1] + period
                half = 0.4 if kind != "pawl" else 0.22
                axes.broken_barh(list(zip(begins, ends - begins, strict=True)), (row - half, 2 * half),
                                 color=TIMELINE_LOOKS[kind][1], linewidth=0.0)  # fmt: skip
    _name_rows(axes, list(rows))
    looks = [TIMELINE_LOOKS[kind] for kind in used]
    style.legend_beside(axes, [(word, {"color": colour, "linewidth": 6}) for word, colour in looks])


def pawls_engaged(played: ScenarioResult) -> NDArray[np.bool_]:
    """Return in which cycles (K, m) a pawl carried a cable; known with a simulated person only, else in none."""
    run, person = played.run, played.person
    found = np.zeros(run.commanded_brakes.shape, dtype=bool)
    if person is None:
        return found
    for index in range(run.rig.m):
        commanded = run.time[run.commanded_brakes[:, index]]
        if commanded.size:
            actual = np.interp(run.time, person.time, person.tensions[:, index])
            latest = np.searchsorted(commanded, run.time, side="right") - 1
            soon = (latest >= 0) & (run.time - commanded[np.maximum(latest, 0)] <= PAWL_RELEASE_S)
            found[:, index] = soon & (actual > np.nan_to_num(run.measured[:, index]) + PAWL_FORCE_N)
    return found


def draw_check_table(axes: Axes, rows: Sequence[Check]) -> None:
    """Write expected and measured values, a line each, with a mark."""
    axes.axis("off")
    axes.set(xlim=(0.0, 1.0), ylim=(len(rows) + 0.5, -0.5))
    missed = sum(not row.met for row in rows)
    axes.text(0.0, 0.0, "Expected and measured", va="center", fontweight="bold")
    for x, heading in ((EXPECTED_X, "expected"), (MEASURED_X, "measured")):
        axes.text(x, 0.0, heading, ha="right", va="center", color=GREY)
    summary = f"{missed} of {len(rows)} not as expected" if missed else "all as expected"
    axes.text(SUMMARY_X, 0.0, summary, va="center", fontweight="bold", color=RED if missed else GREEN)
    for number, row in enumerate(rows, start=1):
        colour, mark = (GREEN, "\N{CHECK MARK}") if row.met else (RED, "\N{BALLOT X}")
        low, high, measured = (
            f"{value:.3g}" if math.isfinite(value) else "\N{EN DASH}"
            for value in (row.low, row.high, row.measured)
        )
        unit = row.unit.removeprefix("1")
        axes.axhline(number - 0.5, color="#E4E4E4", linewidth=0.7)
        axes.text(0.0, number, mark, color=colour, va="center", fontsize=11)
        axes.text(0.025, number, row.name, va="center")
        axes.text(EXPECTED_X, number, f"{low} to {high} {unit}", ha="right", va="center")
        axes.text(MEASURED_X, number, f"{measured} {unit}", ha="right", va="center", weight="bold", color=colour)
