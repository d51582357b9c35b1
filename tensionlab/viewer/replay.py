"""The page of a log: a run as it was, at any time and speed, and what another solver would have done."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tensionlab.allocation import Allocation
from tensionlab.errors import TensionlabError
from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.log.shared_run import POLL_S
from tensionlab.scenarios.scenery import Scenery
from tensionlab.support.arrays import Floats
from tensionlab.viewer import live_words, playback, replay_words, words
from tensionlab.viewer.instant import Instant
from tensionlab.viewer.panel import PANEL_PIXELS, entered, pressed, solver_names
from tensionlab.viewer.playback import ALL, SPEEDS, Change, Playback, cycle_at
from tensionlab.viewer.recorded import answer_at, info_of, instant_at, report_at
from tensionlab.viewer.run_drawing import RunDrawing
from tensionlab.viewer.run_marks import KINDS, Mark, marks, phase_bands
from tensionlab.viewer.server import PageServer

WORDS_PERIOD_S = 0.1
"""Of texts while the run is played; the scene follows more often."""
TIMELINE_PIXELS, TIMELINE_SHARE = 660.0, 0.22
"""Width of the timeline, and the share of the picture that is behind it, from below."""
STEP_S = 0.001
"""Of the slider."""
NONE = "none"


class ReplayPage:
    """A run from its log in the browser.

    Call `turn` some thirty times a second, in one thread; `serve` does.
    """

    def __init__(self, run: Run, server: PageServer, solver: str = "", scenery: Scenery | None = None) -> None:
        self.server = server
        begin, end = float(run.time[0]), float(run.time[-1])
        self.state = Playback(begin, end, begin, solver=solver)
        self._run, self._info, self._scenery = run, info_of(run), scenery
        self._marks = marks(run)
        durations = {} if scenery is None else {each.name: each.end - each.begin for each in scenery.phases}
        self._bands = phase_bands(self._marks, end, durations)
        self._curves = replay_words.curves(run)
        self._changes: deque[Change] = deque()
        self._shown: Playback | None = None
        self._drawn: tuple[int, str] | None = None
        self._answer: tuple[Allocation | None, str] = (None, "")
        self._now, self._words_due = time.perf_counter(), 0.0
        self._drawing = RunDrawing(server.viser, run.rig, instant_at(run, 0), scenery, covered=TIMELINE_SHARE)
        self._add_timeline()
        self._add_panel()
        self.turn()

    def change(self, change: Change) -> None:
        """Have the state changed, in the next turn; from any thread."""
        self._changes.append(change)

    @property
    def index(self) -> int:
        """Of the cycle that is shown."""
        return cycle_at(self._run.time, self.state.time)

    @property
    def listed(self) -> list[Mark]:
        """Events of the kind that is chosen."""
        return [mark for mark in self._marks if self.state.kind in (ALL, mark.kind)]

    def _add_timeline(self) -> None:
        gui = self.server.viser.gui
        panel = gui.add_panel()
        panel.float(x=15, y=-15, width=TIMELINE_PIXELS)
        with panel.add_tab("Timeline"):
            self._timeline = gui.add_html("")
            begin = math.floor(self.state.begin / STEP_S) * STEP_S
            end = math.floor(self.state.end / STEP_S + 1.0) * STEP_S
            self._slider: Any = gui.add_slider("time s", begin, end, STEP_S, begin)
            entered(self._slider, lambda: self.change(partial(playback.seek, time=float(self._slider.value))))
            buttons = gui.add_button_group("", ("Previous event", "Play", "Pause", "Next event"))
            actions: dict[str, Change] = {
                "Previous event": lambda state: playback.step(state, self._times(), -1),
                "Play": playback.play,
                "Pause": playback.pause,
                "Next event": lambda state: playback.step(state, self._times(), 1),
            }
            pressed(buttons, lambda: self.change(actions[buttons.value]))
            speeds = {f"{each:g} x": each for each in SPEEDS}
            self._speed: Any = gui.add_dropdown("speed", tuple(speeds), initial_value="1 x")
            entered(self._speed, lambda: self.change(playback.choose(speed=speeds[self._speed.value])))

    def _add_panel(self) -> None:
        gui = self.server.viser.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PIXELS)
        self._theme()
        self._heading, self._played, self._forces = (gui.add_html("") for _ in range(3))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Modules"):
            self._modules = gui.add_html("")
        with tabs.add_tab("Events"):
            kinds = (ALL, *(kind for kind in KINDS if any(mark.kind == kind for mark in self._marks)))
            self._kind: Any = gui.add_dropdown("show", kinds)
            entered(self._kind, lambda: self.change(playback.choose(kind=self._kind.value)))
            self._jump: Any = gui.add_dropdown("go to", self._choices())
            entered(self._jump, lambda: self.change(self._jumped()))
            self._events = gui.add_html("")
        with tabs.add_tab("Solver"):
            names = (NONE, *solver_names(self._run.rig))
            self._solver: Any = gui.add_dropdown("beside", names, initial_value=self.state.solver or NONE)
            entered(
                self._solver, lambda: self.change(playback.choose(solver=self._solver.value.replace(NONE, "")))
            )
            self._beside = gui.add_html("")
        with tabs.add_tab("Loop"):
            self._loop = gui.add_html("")
            dark = gui.add_checkbox("dark", False)
            entered(dark, lambda: self.change(playback.choose(dark=dark.value)))

    def _theme(self) -> None:
        self.server.viser.gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, dark_mode=self.state.dark
        )

    def _times(self) -> Floats:
        return np.array([mark.time for mark in self.listed])

    def _choices(self) -> tuple[str, ...]:
        """Return the events to go to, each another text."""
        width = len(str(len(self.listed)))
        return (
            "...",
            *(f"{number:{width}d}. {mark.time:.2f} s {mark.text}" for number, mark in enumerate(self.listed, 1)),
        )

    def _jumped(self) -> Change:
        word = self._jump.value.partition(".")[0]
        return partial(playback.seek, time=self.listed[int(word) - 1].time) if word else lambda state: state

    def turn(self) -> None:
        """Make what people did, let the time pass, and bring all browsers up to date."""
        before, self._now = self._now, time.perf_counter()
        state = playback.advance(self.state, self._now - before)
        while self._changes:
            state = self._changes.popleft()(state)
        self.state = state
        if state == self._shown:
            return
        due = self._now >= self._words_due or not state.playing
        with self.server.viser.atomic():
            self._draw()
            if due:
                self._words_due = self._now + WORDS_PERIOD_S
                self._show_words()
        self.server.viser.flush()
        self._shown = state if due else self._shown

    def _draw(self) -> None:
        """Show the cycle, if it or the solver beside it is another than before."""
        if (self.index, self.state.solver) == self._drawn:
            return
        self._drawn = self.index, self.state.solver
        self._answer = self._answered()
        self._drawing.show(self._instant())

    def _answered(self) -> tuple[Allocation | None, str]:
        """Return what the solver beside answers, and why it does not."""
        if not self.state.solver:
            return None, ""
        try:
            return answer_at(self._run, self.index, self.state.solver), ""
        except TensionlabError as error:
            return None, str(error)

    def _instant(self) -> Instant:
        return instant_at(self._run, self.index, self.state.solver, self._answer[0])

    def _show_words(self) -> None:
        run, state, index, listed = self._run, self.state, self.index, self.listed
        report, instant = report_at(run, index), self._instant()
        self._heading.content = replay_words.heading(run, state, index)
        self._timeline.content = replay_words.timeline(state, listed, self._bands, self._curves)
        self._played.content = live_words.phases(self._scenery, state.time)
        self._forces.content = live_words.forces(run.rig, instant)
        self._modules.content = live_words.modules(self._info, report, instant)
        self._events.content = replay_words.events(listed, state.time)
        self._loop.content = live_words.times(self._info, report, report.start_delays, report.compute_times)
        self._beside.content = self._said_beside()
        self._slider.value = round(state.time, 3)
        self._speed.value, self._kind.value = f"{state.speed:g} x", state.kind
        self._solver.value = state.solver or NONE
        if self._shown is None or state.kind != self._shown.kind:
            self._jump.options = self._choices()
        self._jump.value = "..."
        if self._shown is not None and state.dark is not self._shown.dark:
            self._theme()

    def _said_beside(self) -> str:
        found, problem = self._answer
        if problem:
            return words.problem(problem)
        if not self.state.solver:
            return words.note("Choose a solver to see what it would have commanded.")
        return replay_words.answer(self._run, self.index, self.state.solver, found)

    def serve(self, until: Callable[[], bool]) -> None:
        """Show the run until a function says so, asked in each turn."""
        while not until():
            self.turn()
            time.sleep(POLL_S)

    def close(self) -> None:
        """Close the page."""
        self.server.close()
