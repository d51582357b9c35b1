"""The page of a log: a run at any time and speed."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import measured_wrench
from tensionlab.errors import LogError
from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.sharing import RunInfo, RunSnapshot
from tensionlab.scenarios.scenery import Scenery
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREEN, GREY, ORANGE, PURPLE, RED
from tensionlab.support.formatting import format_number
from tensionlab.viewer.html import render
from tensionlab.viewer.run_page import RunPage
from tensionlab.viewer.run_scene import Instant, RunDrawing
from tensionlab.viewer.server import PageServer, on_input, on_press

SPEEDS = {f"{speed:g} x": speed for speed in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)}
TEXT_PERIOD_S = 0.1  # period of texts while the run is played; the scene follows more often
# Width of the timeline, and the share of the picture that is behind it, from below.
TIMELINE_PIXELS, TIMELINE_SHARE = 660.0, 0.22
STEP_S = 0.001  # step of the slider
SAME_S = 1e-6  # largest difference of times that count as the same
BINS = 400  # points of a curve in the timeline: about as many as it has pixels
SHOWN_TIMES = 1000  # number of latest cycles over which times of the loop are shown
# Kinds of marks, and their colours; "run" marks its end, and lost modules.
KINDS = {"phase": GREY, "run": BLUE, "status": ORANGE, "fault": RED, "limiter": PURPLE, "brake": GREEN}
GAP_S = 0.25  # longest interruption within one spell of an event
LISTED_MARKS = 14  # number of events around the time that is shown
MIN_ERROR_N = 0.01  # largest difference between the desired and the demanded wrench that is not mentioned


@dataclass(frozen=True)
class Playback:
    """Time of a run that is shown, and how it passes; times are in s since the run began."""

    begin: float
    end: float
    time: float = 0.0
    speed: float = 1.0  # of playing, in times of the run's own
    playing: bool = False

    def seek(self, time: float) -> Playback:
        """Show another time, and stop there."""
        return replace(self, time=min(max(time, self.begin), self.end), playing=False)

    def play(self) -> Playback:
        """Let time pass; from the begin if it is at the end."""
        over = self.time >= self.end - SAME_S
        return replace(self, time=self.begin if over else self.time, playing=True)

    def advance(self, elapsed: float) -> Playback:
        """Let a time in s pass outside; it stops at the end."""
        if not self.playing:
            return self
        time = self.time + self.speed * elapsed
        return replace(self, time=min(time, self.end), playing=time < self.end)

    def step(self, times: Sequence[float], direction: int) -> Playback:
        """Go to the next of some times, or to the previous one for -1, and stop there."""
        ahead = [time for time in times if direction * (time - self.time) > SAME_S]
        return self.seek(min(ahead, key=lambda time: abs(time - self.time), default=self.time))


Change = Callable[[Playback], Playback]


class ReplayPage(RunPage):
    """A run from its log in the browser."""

    def __init__(self, run: Run, server: PageServer, scenery: Scenery | None = None) -> None:
        super().__init__(server)
        begin, end = float(run.time[0]), float(run.time[-1])
        self.playback, self.scenery = Playback(begin, end, begin), scenery
        self._run, self._info = run, info_of(run)
        self._marks, self._curves = marks(run), curves(run)
        self._changes: deque[Change] = deque()
        self._shown: Playback | None = None
        self._drawn = -1
        self._now, self._texts_due = time.perf_counter(), 0.0
        self._drawing = RunDrawing(server.viser, run.rig, instant_at(run, 0), scenery, TIMELINE_SHARE)
        self._add_timeline()
        self.turn()

    def change(self, change: Change) -> None:
        """Queue a change of the playback for the next turn; from any thread."""
        self._changes.append(change)

    @property
    def index(self) -> int:
        """Index of the cycle that is shown."""
        return max(int(np.searchsorted(self._run.time, self.playback.time + SAME_S, "right")) - 1, 0)

    def _add_timeline(self) -> None:
        gui = self.server.viser.gui
        panel = gui.add_panel()
        panel.float(x=15, y=-15, width=TIMELINE_PIXELS)
        times = [mark.time for mark in self._marks]
        actions: dict[str, Change] = {
            "Previous event": lambda now: now.step(times, -1),
            "Play": Playback.play,
            "Pause": lambda now: replace(now, playing=False),
            "Next event": lambda now: now.step(times, 1),
        }
        with panel.add_tab("Timeline"):
            self._timeline = gui.add_html("")
            begin = math.floor(self.playback.begin / STEP_S) * STEP_S
            end = math.floor(self.playback.end / STEP_S + 1.0) * STEP_S
            self._slider: Any = gui.add_slider("time s", begin, end, STEP_S, begin)
            on_input(self._slider, lambda: self.change(lambda now: now.seek(float(self._slider.value))))
            buttons = gui.add_button_group("", tuple(actions))
            on_press(buttons, lambda: self.change(actions[buttons.value]))
            speed: Any = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 x")
            on_input(speed, lambda: self.change(lambda now: replace(now, speed=SPEEDS[speed.value])))

    def turn(self) -> None:
        """Let the time pass, make the changes of people, and bring all browsers up to date."""
        previous_time, self._now = self._now, time.perf_counter()
        playback = self.playback.advance(self._now - previous_time)
        while self._changes:
            playback = self._changes.popleft()(playback)
        self.playback = playback
        if playback == self._shown:
            return
        due = self._now >= self._texts_due or not playback.playing
        with self.server.viser.atomic():
            if self.index != self._drawn:
                self._drawn = self.index
                self._drawing.show(instant_at(self._run, self.index))
            if due:
                self._texts_due, self._shown = self._now + TEXT_PERIOD_S, playback
                self._show_all_texts(playback, self.index)
        self.server.viser.flush()

    def _show_all_texts(self, playback: Playback, index: int) -> None:
        self._heading.content = cycle_heading(self._run, playback, index)
        span = max(playback.end - playback.begin, SAME_S)
        ticks = [((mark.time - playback.begin) / span, KINDS[mark.kind]) for mark in self._marks]
        now = (playback.time - playback.begin) / span
        self._timeline.content = render("run.timeline", *self._curves, ticks, now)
        self._events.content = marks_html(self._marks, playback.time)
        self._slider.value = round(playback.time, 3)
        self.show_texts(self._info, report_at(self._run, index), instant_at(self._run, index), fresh=True)


def cycle_heading(run: Run, playback: Playback, index: int) -> str:
    """Return the status of a cycle, and where in the run it is."""
    demanded, desired = run.demanded[index], run.desired[index]
    limited = run.status[index] == Status.EXACT and not np.allclose(demanded, desired, atol=MIN_ERROR_N)
    return render("run.cycle_heading", run, index, playback.time, playback.end, limited)


def curves(run: Run) -> tuple[list[tuple[str, str, str]], float]:
    """Return name, colour and SVG path of the desired and measured force over time, and the largest force."""
    d = run.rig.dimension
    measured = np.linalg.norm(measured_wrench(run.structure[:, :d], run.measured, run.active), axis=1)
    sizes = {"desired": np.linalg.norm(run.desired[:, :d], axis=1), "measured": measured}
    known = np.concatenate([size[np.isfinite(size)] for size in sizes.values()])
    largest = float(known.max(initial=0.0)) or 1.0
    return [(name, FORCE_COLOURS[name], _path(run.time, size / largest)) for name, size in sizes.items()], largest


def _path(time: Floats, share: Floats) -> str:
    """Return an SVG path through the largest share (K,) in each of `BINS` parts of the time, broken at gaps."""
    span = max(float(time[-1] - time[0]), SAME_S)
    part = np.minimum((BINS * (time - time[0]) / span).astype(np.int64), BINS - 1)
    largest = np.full(BINS, -1.0)
    known = np.isfinite(share)
    np.maximum.at(largest, part[known], share[known])
    words, drawing = [], False
    for index in np.unique(part).tolist():
        if largest[index] >= 0.0:
            words.append(f"{'L' if drawing else 'M'}{(index + 0.5) / BINS:.4f} {1.0 - 0.96 * largest[index]:.3f}")
        drawing = bool(largest[index] >= 0.0)
    return "".join(words)


def require_drawable(run: Run, path: str | PathLike[str]) -> None:
    """Refuse a run of which nothing can be drawn: LogError, naming the file."""
    if not len(run):
        raise LogError(f"{path}: the run ended before its first cycle; there is nothing to show")
    if (np.diff(run.time) < 0.0).any():
        raise LogError(f"{path}: its cycles are not in the order of time; the log is damaged")
    placed = np.isfinite(run.position).all(axis=1) & np.isfinite(run.anchors).all(axis=(1, 2))
    if not placed.all():
        raise LogError(
            f"{path}: in cycle {run.cycle[~placed][0]} it is not known where the hand and all anchors are; "
            "there is nothing to draw"
        )


def info_of(run: Run) -> RunInfo:
    """Return the constant data of the run."""
    setup, call = run.setup, str(run.manifest.get("call", ""))
    return RunInfo(0, 0, call, run.rig, setup.solver, setup.rate, setup.ttl, setup.links, setup.scenery)


def instant_at(run: Run, index: int) -> Instant:
    """Return the instant of the cycle of an index."""
    return Instant.of(run.rig, _cycle(run, index))


def _cycle(run: Run, index: int) -> dict[str, NDArray[Any]]:
    return {name: getattr(run, name)[index] for name in COLUMNS}


def report_at(run: Run, index: int) -> RunSnapshot:
    """Return the report of the run after the cycle of an index; NaN and 0 for values that logs do not have."""
    m, done = run.rig.m, index + 1
    events = tuple(event for event in run.events if event.cycle <= run.cycle[index])
    deadlines = np.round((run.time[[0, index]] - run.start_delay[[0, index]]) * run.setup.rate)
    fallback = int(run.fallback_used[:done].sum())
    counts = np.bincount(run.status[:done], minlength=len(Status)).tolist()
    statuses = Counter(dict(zip(Status, counts, strict=True)))
    return RunSnapshot(
        number=0,
        over=False,
        cycle=_cycle(run, index),
        bad_frames=np.zeros(m, np.int64),
        telemetry=(None,) * m,
        start_delays=run.start_delay[max(done - SHOWN_TIMES, 0) : done],
        compute_times=run.compute_time[max(done - SHOWN_TIMES, 0) : done],
        cycles=done,
        missed=int(deadlines[1] - deadlines[0]) + 1 - done,
        fallback_used=fallback,
        answers=Statistics(statuses=statuses, fallback_used=fallback).answers,
        lost={event.module: event.text for event in events if event.kind == "lost"},
        unconfirmed={},
        ended="",
        emergency=False,
        events=events,
    )


class RunMark(NamedTuple):
    """Event at a time in s since the run began, of one of `KINDS`, in words."""

    time: float
    kind: str
    text: str


def marks(run: Run) -> tuple[RunMark, ...]:
    """Return the events of a run in order of time; a lasting one at its begin, with its duration."""
    run_marks = []
    for event in run.events:
        subject = f"{event.module}: " if event.module else ""
        if event.kind in ("phase", "brake"):
            run_marks.append(RunMark(event.time, event.kind, f"{subject}{event.text}"))
        else:
            run_marks.append(RunMark(event.time, "run", f"{event.kind}: {subject}{event.text}"))
    for kind, text, flags in _flags(run):
        for first, last in spells(run.time, flags):
            begin, over = float(run.time[first]), last == len(run) - 1
            duration = "to the end" if over else f"for {format_number(float(run.time[last + 1]) - begin)} s"
            run_marks.append(RunMark(begin, kind, f"{text}, {duration}"))
    return tuple(sorted(run_marks, key=lambda mark: mark.time))


def _flags(run: Run) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """Yield kind, text and cycles (K,) of each event that the columns of a run show."""
    for status in Status:
        if status is not Status.EXACT:
            yield "status", status.name, run.status == status
    yield "status", "unproven: newton's answer was sent", run.fallback_used
    for index, module in enumerate(run.rig.modules):
        for fault in Fault:
            yield "fault", f"{module.name}: {fault.name}", (run.faults[:, index] & fault) != 0
        for limit in Limit:
            if limit is not Limit.NONE:
                yield "limiter", f"{module.name}: {limit.name}", run.limiters[:, index] == limit
        yield "brake", f"{module.name}: brake commanded on", run.commanded_brakes[:, index]
        yield "brake", f"{module.name}: brake closed", run.brake_states[:, index] == BrakeState.CLOSED


def spells(time: NDArray[np.float64], flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and the last index of each spell of flags (K,), over gaps shorter than `GAP_S`."""
    at = np.flatnonzero(flags)
    if not len(at):
        return []
    breaks = np.flatnonzero((np.diff(at) > 1) & (time[at[1:]] - time[at[:-1] + 1] >= GAP_S))
    firsts, lasts = at[np.append(0, breaks + 1)], at[np.append(breaks, len(at) - 1)]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def marks_html(marks: Sequence[RunMark], time: float) -> str:
    """Return the events of a log around a time, the latest before it marked."""
    latest = sum(mark.time <= time + SAME_S for mark in marks) - 1
    first = max(min(latest - LISTED_MARKS // 2, len(marks) - LISTED_MARKS), 0)
    return render("run.events", marks[first : first + LISTED_MARKS], KINDS, latest - first)
