"""Figure of a run: wrenches, tensions, status and limiters of the modules, and timing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import measured_wrench
from tensionlab.haptics.rendering.fidelity import just_noticeable
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit
from tensionlab.plots.style import HALO, legend_beside, new_figure
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
AXES_WIDTH = 720.0  # width of the axes, about, in points
MIN_TIME_MS = 1e-2  # times below are drawn here, in ms
MIN_AMPLITUDE_N, MIN_SPECTRUM = 1e-3, 16  # smaller amplitudes are drawn here; cycles that a spectrum needs
MIN_RANGE = 0.05  # forces and torques are drawn at least so far up and down, in N and N·m
TIMES = {"start delay": BLUE, "compute time": GREEN, "oldest telemetry": ORANGE}
WRENCH_LOOKS: dict[str, dict[str, Any]] = {
    "desired": {"linewidth": 4, "alpha": 0.35},
    "commanded": {"linewidth": 1.2},
    "measured": {"linewidth": 1.0, "linestyle": ":"},
}


def plot_run(run: Run) -> Figure:
    """Draw a run, from above: wrench and error, tension of each module, status and limiters, times, spectrum.

    Examples
    --------
    >>> from tensionlab import plots
    >>> from tensionlab.scenarios import load_scenario
    >>> from tensionlab.scenarios.play import play, simulate_modules
    >>> recoil = load_scenario("recoil")
    >>> figure = plots.plot_run(play(recoil, simulate_modules(recoil), seconds=0.5).run)
    """
    d, m, n = run.rig.dimension, run.rig.m, run.rig.n
    wrenches = {"force (N)": slice(0, d)} | ({"torque (N·m)": slice(d, n)} if n > d else {})
    heights = [1.7] * len(wrenches) + [1.2] + [0.8] * m + [0.35 + 0.17 * (m + 2), 1.5, 1.7]
    with new_figure((13.0, 0.7 + 1.08 * sum(heights))) as figure:
        figure.suptitle(_title(run), fontweight="bold")
        *panels, spectrum = figure.subplots(len(heights), 1, height_ratios=heights)
        for axes in panels[:-1]:
            axes.sharex(panels[-1])
            axes.tick_params(labelbottom=False)
        error, *tensions, timeline, times = panels[len(wrenches) :]
        measured = measured_wrench(run.structure, run.measured, run.active)
        for axes, (label, part) in zip(panels, wrenches.items(), strict=False):
            _draw_wrench(axes, run, measured, part)
            axes.set_ylabel(label)
        _draw_error(error, run, run.desired[:, :d], measured[:, :d])
        _draw_spectrum(spectrum, run, run.desired[:, :d], measured[:, :d])
        top = _top(run)
        for index, axes in enumerate(tensions):
            _draw_tension(axes, run, index, top)
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
        dashed = {"color": GREY, "linestyle": "--", "linewidth": 0.9}
        legend_beside(panels[0], [
            *((axis, {"color": colour}) for axis, colour in list(AXIS_COLOURS.items())[:d]),
            *((name, {"color": GREY, **look}) for name, look in WRENCH_LOOKS.items()),
        ])  # fmt: skip
        shown = [
            ("commanded", {"color": BLUE, "linewidth": 1.2}),
            ("measured", {"color": ORANGE, "linewidth": 1.2}),
        ]
        legend_beside(tensions[0], [*shown, ("limits", dashed)])
        legend_beside(timeline, [(word, {"color": colour, "linewidth": 6}) for word, colour in used])
        legend_beside(times, [*((word, {"color": colour}) for word, colour in TIMES.items()), ("period", dashed)])
    return figure


def _title(run: Run) -> str:
    policy = f", nearest in {run.setup.policy}" if run.setup.policy else ""
    length = f"{len(run)} cycles, {run.setup.rate:g} a second"
    cut = "" if run.complete else "; the log was cut off"
    return f"{run.rig.name}, {run.setup.solver}{policy}: {length}{cut}"


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
    axes.set(ylabel="error (N)", ylim=(0.0, None))
    shade = {"color": "#EDEDED", "linewidth": 6}
    legend_beside(axes, [("|measured - desired|", {"color": RED}), ("not noticeable", shade)])


def _draw_spectrum(axes: Axes, run: Run, desired: Floats, measured: Floats) -> None:
    """Draw the amplitudes of the forces over frequency, and lines where telemetry shows vibrations."""
    forces = {"desired": desired, "measured": measured}
    for (name, force), colour in zip(forces.items(), (GREY, BLUE), strict=True):
        hertz, amplitude = force_spectrum(run.time, force)
        axes.plot(
            hertz, np.maximum(amplitude, MIN_AMPLITUDE_N), color=colour, **WRENCH_LOOKS[name] | {"linestyle": "-"}
        )
    rate = 1.0 / float(np.median(np.diff(run.time))) if len(run) > 1 else run.setup.rate
    for name, effect in run.effects.items():
        for frequency in np.unique(effect.frequency[(effect.amplitude > 0.0) & (effect.share > 0.0)]):
            shown = abs(frequency - rate * round(frequency / rate))
            label = f"{name}: {frequency:.3g} Hz" + ", aliased by the telemetry" * bool(shown != frequency)
            axes.axvline(shown, color=RED, linewidth=0.8, linestyle="--")
            axes.annotate(label, (shown, 1.0), xycoords=("data", "axes fraction"), color=RED, fontsize=8, va="top")
    axes.set(xlabel="frequency (Hz)", ylabel="amplitude (N)", yscale="log", xlim=(0.0, rate / 2.0))
    axes.grid()
    legend_beside(axes, [("desired", {"color": GREY, **WRENCH_LOOKS["desired"]}), ("measured", {"color": BLUE})])


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


def _top(run: Run) -> float:
    """Return the upper end of the axes of tensions: above the limit, unless the run stayed far below it."""
    upper = max(run.setup.upper)
    pulled = np.fmax.reduce(np.concatenate([run.commanded.ravel(), run.measured.ravel(), [0.0]]))
    return float(1.12 * upper if pulled > 0.3 * upper or pulled == 0.0 else 1.3 * pulled)


def _draw_tension(axes: Axes, run: Run, index: int, top: float) -> None:
    lower, upper = run.setup.lower[index], run.setup.upper[index]
    for limit in (lower, upper):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9)
    axes.plot(run.time, run.measured[:, index], color=ORANGE, linewidth=1.2)
    axes.plot(run.time, run.commanded[:, index], color=BLUE, linewidth=1.2)
    axes.set_ylim(0.0, top)
    axes.set_ylabel("N")
    name = f"{run.rig.modules[index].name}, {lower:g} to {upper:g} N"
    axes.text(0.004, 0.93, name, transform=axes.transAxes, va="top", fontsize=8.5, bbox=HALO, zorder=5)


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
    axes.set(yscale="log", ylabel="ms")


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
