"""Panels of a played scenario: phases, force, tensions, force against distance, timeline, table of checks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.plots.run import COLOURS
from tensionlab.plots.scene import held_name, plane_of
from tensionlab.plots.style import BLUE, COARSE_SHADE, GREEN, GREY, ORANGE, RED, legend_beside, two_scales
from tensionlab.scenarios.checks import ForceRecord, rendered_force

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.scenarios import Phase
    from tensionlab.scenarios.checks import Check
    from tensionlab.scenarios.play import ScenarioResult

MIN_FORCE_SHARE = 0.1
"""An axis is drawn if its force gets to this share of the largest."""
PHASE_SHADES = ("#DCE6F0", "#C4D5E6")
"""Of the phases, in turn."""
KNEE = 1.3
"""Beyond so many times the motors' largest tension, forces are drawn on a coarse scale."""
SETTLING_S = 0.3
"""Within so long of a phase's begin, forces are those of modules that start, or of what was before."""
NEAR_M = 0.12
"""So far from a surface its force is drawn."""
PAWL_FORCE_N = 1.0
"""A pawl holds where the cable pulls by so much harder than its motor ..."""
PAWL_RELEASE_S = 0.3
"""... and for so long after its brake was commanded."""
TIMELINE_LOOKS = {
    "brake": ("brake commanded", "#A8D8C8"),
    "pawl": ("pawl holds the cable", GREEN),
    "local": ("module-local spring or vibration", "#CC79A7"),
}
"""Words and colours of the bars of a timeline."""
MARK_X, NAME_X, LOW_X, HIGH_X, MEASURED_X, UNIT_X = 0.0, 0.025, 0.52, 0.59, 0.66, 0.67
"""Columns of the table of checks, as shares of the width: marks, names and units begin there, numbers end."""
GAUGE_X = (0.77, 1.0)
"""Ends of its gauges; what is expected takes the middle half."""
WIDE: dict[str, Any] = {"linewidth": 5.0, "alpha": 0.3}
THIN: dict[str, Any] = {"linewidth": 1.2}


def knee_of(played: ScenarioResult) -> float:
    """Return the force, in N, beyond which the scale is coarse: above what motors pulled with, or one can."""
    motors = np.linalg.norm(rendered_force(replace(played, person=None)).force, axis=1)
    return KNEE * max(float(motors.max()), *played.run.setup.upper)


def lanes_of(phases: Iterable[Phase]) -> list[list[Phase]]:
    """Return lanes in which phases do not overlap."""
    lanes: list[list[Phase]] = []
    for phase in sorted(phases, key=lambda each: each.begin):
        free = next((lane for lane in lanes if lane[-1].end <= phase.begin + 1e-9), None)
        if free is None:
            lanes.append([phase])
        else:
            free.append(phase)
    return lanes


def draw_phases(axes: Axes, lanes: list[list[Phase]], last: float) -> None:
    """Draw phases as bars with their names, up to the last time."""
    for row, lane in enumerate(lanes):
        for number, phase in enumerate(lane):
            if (length := min(phase.end, last) - phase.begin) > 0.0:
                axes.barh(row, length, 0.84, phase.begin, color=PHASE_SHADES[(row + number) % 2])
                axes.text(phase.begin + length / 2, row, phase.name, ha="center", va="center", fontsize=8.5)
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    axes.set_yticks([])
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(axis="x", length=0)
    axes.set_title("Phases")


def draw_force(axes: Axes, played: ScenarioResult) -> None:
    """Draw the desired force, wide and pale, and the rendered or measured one, along each axis that matters."""
    run, rendered = played.run, rendered_force(played)
    sizes = np.abs(rendered.force).max(axis=0)
    shown = [axis for axis in range(run.rig.dimension) if sizes[axis] >= max(MIN_FORCE_SHARE * sizes.max(), 1e-9)]
    for axis in shown:
        axes.plot(run.time, run.desired[:, axis], color=COLOURS[axis], **WIDE)
        axes.plot(rendered.time, rendered.force[:, axis], color=COLOURS[axis], **THIN)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
    axes.set_ylabel("N")
    axes.set_title(f"Force on the {held_name(played.scenario)}" if shown else "Force")
    two = two_scales(axes, rendered.force[:, shown], knee_of(played))
    axes.grid()
    up = run.rig.vertical
    source = "rendered (simulated)" if played.person is not None else "measured by the modules"
    entries: list[tuple[str, dict[str, Any]]] = [
        *((f"along {'xyz'[axis]}" + ", up" * ("xyz"[axis] == up), {"color": COLOURS[axis]}) for axis in shown),
        ("desired", {"color": GREY, **WIDE}),
        (source, {"color": GREY, **THIN}),
    ]
    legend_beside(axes, entries + [("coarse scale", {"color": COARSE_SHADE, "linewidth": 8.0})] * two)


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
    two_scales(axes, np.append(lines[-1][2], 1.1 * upper), KNEE * max(run.setup.upper))
    axes.grid()
    if index == 0:
        entries = [(name, look) for name, _, _, look in lines]
        legend_beside(axes, [*entries, ("motor limits", {"color": GREY, "linestyle": "--", "linewidth": 0.9})])


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
    run, frame = played.run, played.scenario.seen_from
    rendered, measured = rendered_force(played), rendered_force(replace(played, person=None))
    desired = ForceRecord(run.time, measured.position, run.desired)
    between = f"from {played.scenario.labels.get(frame or '', frame)} to {held_name(played.scenario)} (m)"
    found = []
    for phase in played.scenario.phases:
        plane = plane_of(phase, ["plane"])
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
    two_scales(axes, np.concatenate([each.desired.force, each.rendered.force]), knee)
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
    axes.set_yticks(np.arange(len(rows)), list(rows))
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.spines["left"].set_visible(False)
    looks = [TIMELINE_LOOKS[kind] for kind in used]
    legend_beside(axes, [(word, {"color": colour, "linewidth": 6}) for word, colour in looks])


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
    """Write expected and measured values, a line each, with a mark and a gauge."""
    axes.axis("off")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(rows) + 0.5, -0.5)
    missed = sum(not row.met for row in rows)
    for x, heading in ((LOW_X, "from"), (HIGH_X, "to"), (MEASURED_X, "measured")):
        axes.text(x, 0.0, heading, ha="right", va="center", color=GREY)
    axes.text(MARK_X, 0.0, "Expected and measured", va="center", fontweight="bold")
    summary = f"{missed} of {len(rows)} not as expected" if missed else "all as expected"
    axes.text(GAUGE_X[0], 0.0, summary, va="center", fontweight="bold", color=RED if missed else GREEN)
    for number, row in enumerate(rows, start=1):
        colour, mark = (GREEN, "\N{CHECK MARK}") if row.met else (RED, "\N{BALLOT X}")
        axes.axhline(number - 0.5, color="#E4E4E4", linewidth=0.7)
        axes.text(MARK_X, number, mark, color=colour, va="center", fontsize=11)
        axes.text(NAME_X, number, row.name, va="center")
        looks: tuple[dict[str, Any], ...] = ({}, {}, {"fontweight": "bold", "color": colour})
        values = (row.low, row.high, row.measured)
        for x, value, look in zip((LOW_X, HIGH_X, MEASURED_X), values, looks, strict=True):
            word = f"{value:.3g}" if math.isfinite(value) else "\N{EN DASH}"
            axes.text(x, number, word, ha="right", va="center", **look)
        axes.text(UNIT_X, number, row.unit.removeprefix("1"), va="center", color=GREY)
        _draw_gauge(axes, number, row, colour)


def _draw_gauge(axes: Axes, number: int, row: Check, colour: str) -> None:
    """Draw where a number is between its bounds, or how far beyond."""
    begin, end = GAUGE_X
    quarter = (end - begin) / 4
    bar: dict[str, Any] = {"linewidth": 9.0, "solid_capstyle": "butt"}
    axes.plot(GAUGE_X, [number, number], color="#ECECEC", **bar)
    axes.plot([begin + quarter, end - quarter], [number, number], color="#BFDDD2", **bar)
    if row.high > row.low and math.isfinite(row.high - row.low) and math.isfinite(row.measured):
        share = (row.measured - row.low) / (row.high - row.low)
        place = begin + quarter * min(max(1.0 + 2.0 * share, 0.0), 4.0)
        axes.plot([place], [number], marker="o", markersize=6.5, color=colour)
