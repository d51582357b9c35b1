"""Figure of a run: wrenches, tensions, status and limiters of the modules, and timing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import measured_wrench
from tensionlab.haptics.rendering.fidelity import just_noticeable
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit
from tensionlab.plots.style import curve_look, legend_beside, new_figure
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import AXIS_COLOURS, BLUE, GREEN, GREY, ORANGE, RED
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.hardware.log.reader import Run

BINS = 1500  # number of bins of a longer run, each with the worst of its cycles
LIMITER_LOOKS = [
    ("free", "#EDEDED", {Limit.NONE}),
    ("minimum tension", "#B5D9F0", {Limit.LOWER}),
    ("slew rate", "#F0E442", {Limit.SLEW}),
    ("max tension", ORANGE, {Limit.UPPER}),
    ("speed, length, brake", "#CC79A7", {Limit.SPEED, Limit.LENGTH, Limit.RELEASING}),
    ("heat", RED, {Limit.THERMAL}),
    ("idle or timed out", GREY, {Limit.TIMEOUT, Limit.IDLE}),
]  # limiters of a module, the worse the later
LOST = ("fault, or lost", "#000000")  # worse than all those
NAMED_EVENTS = 8  # largest number of events with a name; further ones are lines alone
NAME_SIZE, LETTER_WIDTH = 8.0, 0.55  # size of their letters in points, and mean width of one as a share of it
AXES_WIDTH = 560.0  # width of the axes, about, in points
MIN_TIME_MS = 1e-2  # times below are drawn here, in ms
MIN_AMPLITUDE_N, MIN_SPECTRUM = 1e-3, 16  # smaller amplitudes are drawn here; cycles that a spectrum needs
DASHED = {"color": GREY, "linestyle": "--", "linewidth": 0.9}
MIN_RANGE = 0.05  # forces and torques are drawn at least so far up and down, in N and N·m
TIMES = {"start delay": BLUE, "compute time": GREEN, "oldest telemetry": ORANGE}
WRENCH_LOOKS: dict[str, dict[str, Any]] = {
    "desired": {"linewidth": 4, "alpha": 0.35},
    "commanded": {"linewidth": 1.2},
    "measured": {"linewidth": 1.0, "linestyle": ":"},
}


def plot_run(run: Run) -> Figure:
    """Draw a run: force, its error, tensions, status and limiters, and times; last, vibrations of effects."""
    d, m, n = run.rig.dimension, run.rig.m, run.rig.n
    wrenches = {"force (N)": slice(0, d)} | ({"torque (N·m)": slice(d, n)} if n > d else {})
    vibrations = _vibrations(run)
    heights = [1.7] * len(wrenches) + [1.0, 1.7, 0.3 + 0.2 * (m + 1), 1.0] + [1.6] * bool(vibrations)
    with new_figure((10.0, 0.8 + 1.1 * sum(heights))) as figure:
        figure.suptitle(_finding(run), fontweight="bold")
        panels = list(figure.subplots(len(heights), 1, height_ratios=heights))
        measured = measured_wrench(run.structure, run.measured, run.active)
        if vibrations:
            _draw_spectrum(panels.pop(), run, run.desired[:, :d], measured[:, :d], vibrations)
        for axes in panels[:-1]:
            axes.sharex(panels[-1])
            axes.tick_params(labelbottom=False)
        error, tensions, timeline, times = panels[len(wrenches) :]
        for axes, (label, part) in zip(panels, wrenches.items(), strict=False):
            _draw_wrench(axes, run, measured, part)
            axes.set_ylabel(label)
        _draw_error(error, run, run.desired[:, :d], measured[:, :d])
        _draw_tensions(tensions, run)
        used = _draw_timeline(timeline, run)
        _draw_times(times, run)
        for axes in panels:
            axes.margins(x=0.0)
            if axes is not timeline:
                axes.grid()
        times.set(xlabel="time (s)", xlim=(0.0, run.time[-1] + 1.0 / run.setup.rate if len(run) else 1.0))
        if not len(run):
            panels[0].text(0.5, 0.5, "no cycle in the log", transform=panels[0].transAxes, ha="center", color=GREY)
        _draw_events(panels, run)
        figure.align_ylabels(panels)
        legend_beside(panels[0], [
            *((axis, {"color": colour}) for axis, colour in list(AXIS_COLOURS.items())[:d]),
            *((name, {"color": GREY, **look}) for name, look in WRENCH_LOOKS.items()),
        ])  # fmt: skip
        legend_beside(timeline, [(word, {"color": colour, "linewidth": 6}) for word, colour in used])
        legend_beside(times, [*((word, {"color": colour}) for word, colour in TIMES.items()), ("period", DASHED)])
    return figure


def _finding(run: Run) -> str:
    """Return the title: how many cycles were exact, and how many were not."""
    policy = f", nearest in {run.setup.policy}" if run.setup.policy else ""
    counts = [int(np.sum(run.status == status)) for status in range(len(STATUS_MARKS))]
    words = [f"{count} {mark.word}" for count, mark in zip(counts, STATUS_MARKS, strict=True) if count]
    cut = "" if run.complete else "; the log was cut off"
    of = f"{len(run)} cycles at {run.setup.rate:g} Hz"
    return f"{run.rig.name}, {run.setup.solver}{policy}: {of}{', ' * bool(words)}{', '.join(words)}{cut}"


def bins_of(count: int) -> NDArray[np.int64]:
    """Return the first cycle of each bin, for a number of cycles."""
    return np.linspace(0, count, min(count, BINS), endpoint=False).astype(np.int64)


def _draw_wrench(axes: Axes, run: Run, measured: Floats, part: slice) -> None:
    local = np.nan_to_num(run.demanded - run.solver_wrench)  # what modules with an impedance, and lost ones, pull
    lines = {"desired": run.desired, "commanded": run.rendered + local, "measured": measured}
    count = run.desired[:, part].shape[1]
    # Where there is one torque only, it is that about z.
    colours = list(AXIS_COLOURS.values())
    for index, colour in enumerate(colours[:count] if count > 1 else colours[2:]):
        for name, wrench in lines.items():
            axes.plot(run.time, wrench[:, part][:, index], color=colour, **WRENCH_LOOKS[name])
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -MIN_RANGE), max(high, MIN_RANGE))  # rounding errors are not worth a panel


def _draw_error(axes: Axes, run: Run, desired: Floats, measured: Floats) -> None:
    """Draw the size of the force error, and the just noticeable difference of the desired force."""
    noticed = [just_noticeable(size) for size in np.linalg.norm(np.nan_to_num(desired), axis=1)]
    axes.fill_between(run.time, 0.0, noticed, color="#EDEDED", linewidth=0.0)
    axes.plot(run.time, np.linalg.norm(measured - desired, axis=1), color=RED, linewidth=1.0)
    axes.set(ylabel="force error (N)", ylim=(0.0, None))
    shade = {"color": "#EDEDED", "linewidth": 6}
    legend_beside(axes, [("|measured - desired|", {"color": RED}), ("not noticeable", shade)])


def _vibrations(run: Run) -> list[tuple[str, float]]:
    """Return the vibrations of effects: name and frequency in Hz."""
    return [
        (name, float(frequency))
        for name, effect in run.effects.items()
        for frequency in np.unique(effect.frequency[(effect.amplitude > 0.0) & (effect.share > 0.0)])
    ]


def _draw_spectrum(
    axes: Axes, run: Run, desired: Floats, measured: Floats, vibrations: list[tuple[str, float]]
) -> None:
    """Draw the amplitudes of the forces over frequency, and lines where telemetry shows vibrations."""
    for force, colour, width in ((desired, GREY, 4.0), (measured, BLUE, 1.0)):
        hertz, amplitude = force_spectrum(run.time, force)
        axes.plot(hertz, np.maximum(amplitude, MIN_AMPLITUDE_N), color=colour, linewidth=width)
    rate = 1.0 / float(np.median(np.diff(run.time))) if len(run) > 1 else run.setup.rate
    for name, frequency in vibrations:
        shown = abs(frequency - rate * round(frequency / rate))
        label = f"{name}: {frequency:.3g} Hz" + ", aliased by the telemetry" * bool(shown != frequency)
        axes.axvline(shown, color=RED, linewidth=0.8, linestyle="--")
        axes.annotate(label, (shown, 1.0), xycoords=("data", "axes fraction"), color=RED, fontsize=8, va="top")
    axes.set(xlabel="frequency (Hz)", ylabel="amplitude (N)", yscale="log", xlim=(0.0, rate / 2.0))
    axes.grid()
    legend_beside(axes, [("desired", {"color": GREY, "linewidth": 4.0}), ("measured", {"color": BLUE})])


def force_spectrum(time: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Return frequencies in Hz and the amplitudes of a force (K, d) there, in N: the norm of those of its axes."""
    known = np.isfinite(force).all(axis=1)
    if known.sum() < MIN_SPECTRUM:
        return np.zeros(0), np.zeros(0)
    even = np.linspace(time[known][0], time[known][-1], int(known.sum()))
    values = np.stack([np.interp(even, time[known], axis[known]) for axis in force.T])
    taper = np.hanning(len(even))
    lines = np.abs(np.fft.rfft((values - values.mean(axis=1, keepdims=True)) * taper)) * 2.0 / taper.sum()
    return np.fft.rfftfreq(len(even), even[1] - even[0]), np.linalg.norm(lines, axis=0)


def _draw_tensions(axes: Axes, run: Run) -> None:
    """Draw the tension of each module, commanded wide and pale, measured thin, between the limits."""
    for limit in np.unique([run.setup.lower, run.setup.upper]):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9)
    names = [module.name for module in run.rig.modules]
    looks = [curve_look(index) for index in range(len(names))]
    for look, commanded, measured in zip(looks, run.commanded.T, run.measured.T, strict=True):
        axes.plot(run.time, commanded, color=look["color"], **WRENCH_LOOKS["desired"])
        axes.plot(run.time, measured, linewidth=1.2, **look)
    axes.set(ylabel="tension (N)", ylim=(0.0, None))
    wide = ("commanded", {"color": GREY, **WRENCH_LOOKS["desired"]})
    legend_beside(axes, [*zip(names, looks, strict=True), wide, ("limits", DASHED)])


def severity(run: Run) -> NDArray[np.int64]:
    """Return what limited each module in each cycle, (K, m): index of `LIMITER_LOOKS`, one more if it is lost."""
    worst = np.zeros(run.limiters.shape, dtype=np.int64)
    for level, (_, _, limits) in enumerate(LIMITER_LOOKS):
        worst[np.isin(run.limiters, [int(limit) for limit in limits])] = level
    broken = np.isin(run.states, [int(state) for state in LATCHED_STATES]) | (run.faults != 0) | ~run.active
    worst[broken] = len(LIMITER_LOOKS)
    return worst


def _draw_timeline(axes: Axes, run: Run) -> list[tuple[str, str]]:
    """Draw status and limiters as rows of colours; return the words and colours that were needed."""
    from matplotlib.colors import ListedColormap

    looks = [(mark.word, mark.colour) for mark in STATUS_MARKS]
    looks += [*((word, colour) for word, colour, _ in LIMITER_LOOKS), LOST]
    names = ["status", *(module.name for module in run.rig.modules)]
    axes.set_yticks(np.arange(len(names)) + 0.5, names)
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.set_ylim(len(names), 0)
    axes.spines["left"].set_visible(False)
    if not len(run):
        return []
    begins = bins_of(len(run))
    edges = np.append(run.time[begins], run.time[-1] + 1.0 / run.setup.rate)
    worst = [run.status[:, None].astype(np.int64), len(Status) + severity(run)]
    rows = np.maximum.reduceat(np.concatenate(worst, axis=1), begins)
    colours = ListedColormap([colour for _, colour in looks])
    for row in range(len(names)):
        axes.pcolormesh(
            edges, [row + 0.08, row + 0.92], rows[None, :, row], cmap=colours, vmin=-0.5, vmax=len(looks) - 0.5,
            rasterized=True,
        )  # fmt: skip
    return [looks[int(level)] for level in np.unique(rows)]


def _draw_times(axes: Axes, run: Run) -> None:
    oldest = np.fmax.reduce(np.where(run.active, run.ages, np.nan), axis=1)
    begins = bins_of(len(run))
    for seconds, colour in zip((run.start_delay, run.compute_time, oldest), TIMES.values(), strict=True):
        worst = np.fmax.reduceat(seconds, begins) if len(run) else seconds
        axes.plot(run.time[begins], np.fmax(1e3 * worst, MIN_TIME_MS), color=colour, linewidth=0.9)
    axes.axhline(1e3 / run.setup.rate, color=GREY, linestyle="--", linewidth=0.9)
    axes.set(yscale="log", ylabel="time (ms)")


def _draw_events(panels: list[Axes], run: Run) -> None:
    """Mark the events, the first ones with their names: each in the lowest row where it covers no other."""
    during = [event for event in run.events if event.cycle >= 0]
    letter_s = NAME_SIZE * LETTER_WIDTH * float(np.ptp(panels[0].get_xlim())) / AXES_WIDTH
    ends: list[float] = []  # of the latest name in each row, in s
    for number, event in enumerate(during):
        for axes in panels:
            axes.axvline(event.time, color=RED, linewidth=0.8, zorder=1)
        if number < NAMED_EVENTS:
            name = f"{event.kind} {event.module}".strip()
            half = 0.5 * (len(name) + 1) * letter_s
            row = next((row for row, end in enumerate(ends) if end <= event.time - half), len(ends))
            ends[row : row + 1] = [event.time + half]
            panels[0].annotate(
                name, (event.time, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2 + 1.2 * NAME_SIZE * row),
                textcoords="offset points", ha="center", va="bottom", color=RED, fontsize=NAME_SIZE,
            )  # fmt: skip
