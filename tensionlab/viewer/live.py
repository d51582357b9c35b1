"""The page of a run in another process: it shows what that process tells on request, and has a stop button.

``python -m tensionlab.viewer.live`` serves it for ``--view`` of a run (`tensionlab.viewer.beside`): the run's
process gives port and token of its publisher on stdin, and gets the page's address on stdout. Whatever happens to
this process or to a browser, the run notices nothing of it.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from tensionlab.errors import LogError, TensionlabError
from tensionlab.hardware.log.shared_run import POLL_S, RunInfo, RunReport, RunWatcher
from tensionlab.scenarios.scenery import Scenery, read_scenery
from tensionlab.support.operating_system import lower_priority
from tensionlab.viewer import live_words
from tensionlab.viewer.instant import Instant
from tensionlab.viewer.run_drawing import RunDrawing
from tensionlab.viewer.server import PageServer
from tensionlab.viewer.stop import StopOutcome, stop_modules

WORDS_PERIOD_S = 0.2
"""Of texts, which nobody reads faster; the scene follows each report."""
SHOWN_TIMES = 1000
"""Latest cycles over which times are shown."""
LINGER_S = 10.0
"""After the end of a run its page stays for as long without a browser: one may be about to open, or to reload."""


class LivePage:
    """A run of another process in the browser.

    Call `turn` some thirty times a second, in one thread; `serve` does.
    """

    def __init__(self, watcher: RunWatcher, server: PageServer) -> None:
        self.server, self._watcher = server, watcher
        self._drawing: RunDrawing | None = None
        self._info: RunInfo | None = None
        self._scenery: Scenery | None = None
        self._shown: RunReport | None = None
        self._fresh = False
        self._beat = 0
        self._words_due = 0.0
        self._starts: deque[float] = deque(maxlen=SHOWN_TIMES)
        self._computes: deque[float] = deque(maxlen=SHOWN_TIMES)
        self._stopping = threading.Lock()
        self._add_panel()
        server.gate.stop = self._answer_stop

    def _add_panel(self) -> None:
        gui = self.server.viser.gui
        self._theme(dark=False)
        gui.main_panel.dock_right()  # beside the picture, so that neither hides the other
        gui.add_html(live_words.style())
        self._outcome, self._heading, self._phases, self._forces = (gui.add_html("") for _ in range(4))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Modules"):
            self._modules = gui.add_html("")
        with tabs.add_tab("Events"):
            self._events = gui.add_html("")
        with tabs.add_tab("Loop"):
            self._times = gui.add_html("")
            dark = gui.add_checkbox("dark", False)

        async def chosen(event: Any) -> None:
            self._theme(dark=dark.value)

        dark.on_update(chosen)

    def _theme(self, *, dark: bool) -> None:
        self.server.viser.gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, dark_mode=dark
        )

    def stop(self) -> StopOutcome | None:
        """Stop all modules, and show what came of it; None while that goes on already."""
        if not self._stopping.acquire(blocking=False):
            return None
        try:
            self._outcome.content = live_words.stopping()
            try:
                outcome = stop_modules(self._watcher)
            except Exception as error:  # whatever it is, people must see that nothing has stopped
                outcome = StopOutcome(False, (repr(error),))
            self._outcome.content = live_words.stopped(outcome)
            return outcome
        finally:
            self._stopping.release()

    def _answer_stop(self) -> tuple[bool, str]:
        """Stop all modules for a request, and return whether they have, and what to say."""
        outcome = self.stop()
        if outcome is None:
            return True, "a stop is in progress already"
        return outcome.confirmed, "\n".join(("STOPPED" if outcome.confirmed else "NOT STOPPED", *outcome.lines))

    def turn(self) -> None:
        """Poll the run, and bring all browsers up to date."""
        self._watcher.poll()
        info, report = self._watcher.info, self._watcher.report
        fresh = self._watcher.condition == "live"
        if info is not None and info is not self._info:
            self._begin(info)
        if report is not None and report is not self._shown:
            self._keep_times(report)
        now = time.perf_counter()
        with self.server.viser.atomic():
            if report is not self._shown or fresh is not self._fresh:
                self._draw(report, fresh=fresh)
            if now >= self._words_due or fresh is not self._fresh:
                self._words_due = now + WORDS_PERIOD_S
                self._show_words(fresh=fresh)
        self.server.viser.flush()
        self._shown, self._fresh = report, fresh

    def _begin(self, info: RunInfo) -> None:
        """Begin to show a run: the first, or another one of its process."""
        self._info = info
        try:
            self._scenery = read_scenery(info.scenery, info.rig, "the run", LogError)
        except LogError:  # of another version of this package: then without it
            self._scenery = None
        self.server.viser.scene.reset()
        self._drawing = None
        self._starts.clear()
        self._computes.clear()
        for part in (self._outcome, self._phases, self._forces, self._modules, self._events, self._times):
            part.content = ""

    def _draw(self, report: RunReport | None, *, fresh: bool) -> None:
        if self._info is None or report is None or report.cycle is None:
            return
        rig = self._info.rig
        instant = Instant.of(rig, report.cycle)
        if self._drawing is None:
            self._drawing = RunDrawing(self.server.viser, rig, instant, self._scenery)
        self._drawing.show(instant, fresh=fresh)

    def _keep_times(self, report: RunReport) -> None:
        """Keep the times of cycles that are new since the report before."""
        new = report.cycles - (0 if self._shown is None or not self._starts else self._shown.cycles)
        self._starts.extend(report.start_delays[-new:] if new else ())
        self._computes.extend(report.compute_times[-new:] if new else ())

    def _show_words(self, *, fresh: bool) -> None:
        info, report, condition = self._info, self._watcher.report, self._watcher.condition
        self._beat += 1
        heading = live_words.heading(condition, self._watcher.age, info, report)
        self._heading.content = live_words.renewed_heading(heading, self._beat)
        if info is None or report is None:
            return
        self._events.content = live_words.events(report)
        if report.cycle is None:
            return
        instant = Instant.of(info.rig, report.cycle)
        for part, text in (
            (self._phases, live_words.phases(self._scenery, instant.time)),
            (self._forces, live_words.forces(info.rig, instant)),
            (self._modules, live_words.modules(info, report, instant, fresh=fresh)),
            (self._times, live_words.times(info, report, np.array(self._starts), np.array(self._computes))),
        ):
            part.content = live_words.renewed(text, self._beat, fresh=fresh)

    def serve(self, until: Callable[[], bool]) -> None:
        """Show the run until a function says so, asked in each turn."""
        while not until():
            self.turn()
            time.sleep(POLL_S)

    def abandoned(self) -> Callable[[], bool]:
        """Return a function that tells whether the run is over and no browser has shown it for `LINGER_S`."""
        wanted = time.perf_counter()

        def over() -> bool:
            nonlocal wanted
            running = self._watcher.condition not in ("ended", "gone")
            if running or self.server.viser.get_clients() or self._stopping.locked():
                wanted = time.perf_counter()
            return time.perf_counter() - wanted > LINGER_S

        return over

    def close(self) -> None:
        """Close the page."""
        self.server.close()
        self._watcher.close()


def main() -> None:
    """Serve the page of the run that stdin names, and open a browser."""
    run = json.loads(sys.stdin.readline())
    try:
        page = LivePage(RunWatcher(run["port"], run["token"]), PageServer())
    except TensionlabError as error:
        print(json.dumps({"error": str(error)}))
        return
    print(json.dumps({"url": page.server.url}), flush=True)
    page.server.open_browser()
    lower_priority()
    try:
        page.serve(page.abandoned())
    finally:
        page.close()


if __name__ == "__main__":
    main()
