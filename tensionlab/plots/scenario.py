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
from tensionlab.scenarios.scenery import scenery
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from tensionlab.scenarios.checks import Check
    from tensionlab.scenarios.play import ScenarioResult

CURVE_HEIGHT, LAYOUT_HEIGHT = (
    2.0,
    5.6,
)  # least height of a panel of force against distance, and of the layout, in inches
MIN_FORCE_SHARE = 0.1  # an axis is drawn if its force gets to this share of the largest
KNEE = 1.3  # multiple of the motors' largest tension beyond which forces are drawn on a logarithmic scale
SETTLING_S = 0.3  # after a phase's begin: forces of modules that start, or of what was before
NEAR_M = 0.12  # largest distance from a surface at which its force is drawn
PAWL_FORCE_N = 1.0  # a pawl holds where the cable pulls this much harder than its motor ..
PAWL_RELEASE_S = 0.3  # ... within this time after its brake was commanded
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
    bars, last = timeline(played), float(run.time[-1])
    heights = [0.1 + 0.25 * len(scenario.phases), 2.7, *([1.0] * run.rig.m)]
    heights += [0.1 + 0.25 * len(bars)] if bars else []
    upper = max(6.8, 1.0 + 1.25 * sum(heights))
    lower = 0.5 + 0.27 * (len(rows) + 1) if rows else 0.0
    with style.new_figure((14.0, upper + lower + 0.4)) as figure:
        figure.suptitle(f"{scenario.title}. {scenario.about}", fontweight="bold", x=0.01, ha="left")
        ratios = [upper, lower] if rows else [upper]
        parts: Any = figure.subfigures(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
        left, right = parts[0].subfigures(1, 2, width_ratios=[1.0, 1.45])
        panels = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        begins = np.array([phase.begin for phase in scenario.phases])
        ends = np.minimum([phase.end for phase in scenario.phases], last)
        panels[0].barh(range(len(begins)), np.maximum(ends - begins, 0.0), 0.84, begins, color="#C4D5E6")
        panels[0].set_title("Phases")
        _name_rows(panels[0], [phase.name for phase in scenario.phases])
        panels[0].spines["bottom"].set_visible(False)
        panels[0].tick_params(axis="x", length=0)
        draw_force(panels[1], played)
        for index in range(run.rig.m):
            draw_tension(panels[2 + index], played, index)
        if bars:
            draw_timeline(panels[-1], played, bars)
        for axes in panels:
            axes.set_xlim(0.0, max(last, 1e-3))
        panels[-1].set_xlabel("time (s)")
        if rows:
            _draw_check_table(parts[1].subplots(), rows)
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
        for panel in panels[len(curves) :]:
            panel.axis("off")
        for panel, each in zip(panels, curves, strict=False):
            panel.plot(*each.desired, color=BLUE, **WIDE)
            panel.plot(*each.rendered, color=BLUE, **THIN)
            panel.grid()
            style.two_scales(panel, np.concatenate([each.desired[1], each.rendered[1]]), knee_of(played))
            panel.set(xlabel=each.distance, ylabel="force (N)", title=each.title)
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
    axes.set_title(f"Force on the {scenery(played.scenario).held_name(run.rig)}" if shown else "Force")
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
    found = []
    for phase in scenario.phases:
        parts = [part for effect in phase.effects.values() for part in (effect, getattr(effect, "wall", None))]
        plane: Any = next((getattr(part, "plane") for part in parts if hasattr(part, "plane")), None)  # noqa: B009
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
        found.append(ForceDistance(phase.name, name, *curves))
    return found


def timeline(played: ScenarioResult) -> dict[str, dict[str, NDArray[np.bool_]]]:
    """Return the rows of brakes and of module-local effects that were on, by name.

    A row has the cycles (K,) in which something was on, by the kinds in `TIMELINE_LOOKS`.
    """
    run, held = played.run, pawls_engaged(played)
    local: NDArray[np.bool_] = np.asarray(np.isfinite(run.impedances).any(axis=2))
    rows = {}
    for index, module in enumerate(run.rig.modules):
        if run.commanded_brakes[:, index].any():
            rows[f"{module.name}, brake"] = {"brake": run.commanded_brakes[:, index], "pawl": held[:, index]}
        if local[:, index].any():
            rows[f"{module.name}, local impedance"] = {"local": local[:, index]}
    return rows


def draw_timeline(axes: Axes, played: ScenarioResult, rows: dict[str, dict[str, NDArray[np.bool_]]]) -> None:
    """Draw the rows of `timeline`, and a legend of the colours."""
    period = 1.0 / played.run.setup.rate
    used: dict[str, None] = {}
    for row, bars in enumerate(rows.values()):
        axes.axhspan(row - 0.4, row + 0.4, color="#F1F1F1", zorder=0)
        for kind, on in bars.items():
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


def _draw_check_table(axes: Axes, rows: Sequence[Check]) -> None:
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
