"""The page of a run in progress, which another process has: what that process reports, and a stop button.

``python -m tensionlab.viewer.live`` serves it for ``--view`` of a run: the run's process writes port and token of
its publisher to stdin, and reads the address of the page from stdout. Whatever happens to this process or to a
browser, the run does not notice.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import NamedTuple

from tensionlab.errors import HardwareError, LogError, TensionlabError
from tensionlab.hardware.client.emergency_stop import RELEASE_TIMEOUT_S, emergency_stop
from tensionlab.hardware.client.locks import SIMULATED
from tensionlab.hardware.client.shared_telemetry import publisher
from tensionlab.hardware.runner.records import DEMAND_STOPPED, DURATION_REACHED
from tensionlab.hardware.sharing import RunInfo, RunSnapshot, RunWatcher
from tensionlab.scenarios.scenery import read_scenery
from tensionlab.support.formatting import format_count
from tensionlab.support.operating_system import OWN_GROUP, kill_command, lower_priority, send_estop
from tensionlab.viewer.html import render
from tensionlab.viewer.run_page import RunPage
from tensionlab.viewer.run_scene import Instant, RunDrawing
from tensionlab.viewer.server import PageServer

TEXT_PERIOD_S = 0.2  # period of texts, faster than they can be read; the scene follows each report
SILENT_S = 3.0  # silence of the page's server after which browsers say so themselves
# Time without a browser after which the page of a run that is over ends; one may be about to reload.
LINGER_S = 10.0
POLL_PERIOD_S = 0.02
SHOWN_EVENTS = 20  # number of latest events that are shown
OVER = ("ended", "gone")  # conditions of a run whose simulated modules pull no more
_started: list[subprocess.Popen[str]] = []  # which outlive the run


class StopOutcome(NamedTuple):
    """Outcome of a stop: whether all modules have confirmed it, and a line on each that has not, or on all."""

    confirmed: bool
    lines: tuple[str, ...]


def stop_modules(watcher: RunWatcher) -> StopOutcome:
    """Stop the modules of a run by an emergency stop, and wait for its outcome.

    Modules that are simulated in the process of the run have no link of their own: that process is signalled
    to stop them, and reports that it did to the watcher, which must be polled meanwhile.
    """
    info = watcher.info
    if info is None:
        return StopOutcome(False, ("which modules there are is not known yet",))
    links = {name: url for name, url in info.links.items() if url != SIMULATED}
    try:
        outcomes = emergency_stop(links) if links else {}
    except HardwareError as error:
        return StopOutcome(False, (str(error),))
    wrong = [f"{name}: {outcome.error}" for name, outcome in outcomes.items() if outcome.error]
    if len(links) < len(info.links) and (problem := _stop_process(watcher, info.pid)):
        wrong.append(problem)
    confirmed = sum(not outcome.error for outcome in outcomes.values()) if wrong else len(info.links)
    return StopOutcome(not wrong, (*wrong, f"confirmed by {format_count(confirmed, 'module')}"))


def _stop_process(watcher: RunWatcher, pid: int) -> str:
    """Tell a process to stop its simulated modules; return why that is not confirmed, empty if it is."""
    if watcher.condition not in OVER:
        try:
            send_estop(pid)
        except PermissionError as error:
            return f"process {pid} cannot be signalled: {error.strerror}"
    end = time.perf_counter() + RELEASE_TIMEOUT_S
    while watcher.condition not in OVER:
        if time.perf_counter() > end:
            return (
                f"process {pid} was signalled and has not reported that its modules stopped; "
                f"end it ({kill_command(pid)}), and its simulated modules with it"
            )
        time.sleep(POLL_PERIOD_S)
    unconfirmed = {} if watcher.report is None else watcher.report.unconfirmed
    return "; ".join(f"{name}: {why}" for name, why in unconfirmed.items())


class LivePage(RunPage):
    """A run of another process in the browser."""

    def __init__(self, watcher: RunWatcher, server: PageServer) -> None:
        super().__init__(server)
        self._watcher = watcher
        self._drawing: RunDrawing | None = None
        self._info: RunInfo | None = None
        self._shown: tuple[RunSnapshot | None, bool] = None, False  # report, and whether it was fresh
        self._beat = 0
        self._texts_due = 0.0
        self._last_used = time.perf_counter()
        self._stopping = threading.Lock()
        server.gate.stop = self.stop

    def stop(self) -> tuple[bool, str]:
        """Stop all modules, and show the outcome; return whether they have stopped, and what to say."""
        if not self._stopping.acquire(blocking=False):
            return True, "a stop is in progress already"
        try:
            self._outcome.content = render("run.stopping")
            try:
                outcome = stop_modules(self._watcher)
            except Exception as error:  # whatever it is, the page must say that nothing has stopped
                outcome = StopOutcome(False, (repr(error),))
            self._outcome.content = render("run.stopped", outcome)
        finally:
            self._stopping.release()
        return outcome.confirmed, "\n".join(("STOPPED" if outcome.confirmed else "NOT STOPPED", *outcome.lines))

    def turn(self) -> None:
        """Poll the run, and bring all browsers up to date."""
        self._watcher.poll()
        info, report, fresh = self._watcher.info, self._watcher.report, self._watcher.condition == "live"
        if info is not None and info is not self._info:
            self._begin(info)
        now, (shown, was_fresh) = time.perf_counter(), self._shown
        with self.server.viser.atomic():
            if report is not shown or fresh is not was_fresh:
                self._draw(report, fresh)
            if now >= self._texts_due or fresh is not was_fresh:
                self._texts_due = now + TEXT_PERIOD_S
                self._show_all_texts(report, fresh)
        self.server.viser.flush()
        self._shown = report, fresh

    def _begin(self, info: RunInfo) -> None:
        """Begin to show a run: the first, or another one of its process."""
        self._info, self._drawing, self.scenery = info, None, None
        with suppress(LogError):  # from another version of this package
            self.scenery = read_scenery(info.scenery, info.rig, "the run", LogError)
        self.server.viser.scene.reset()
        for part in (self._outcome, self._phases, self._forces, self._modules, self._events, self._times):
            part.content = ""

    def _draw(self, report: RunSnapshot | None, fresh: bool) -> None:
        if self._info is None or report is None or report.cycle is None:
            return
        instant = Instant.of(self._info.rig, report.cycle)
        if self._drawing is None:
            self._drawing = RunDrawing(self.server.viser, self._info.rig, instant, self.scenery)
        self._drawing.show(instant, fresh=fresh)

    def _show_all_texts(self, report: RunSnapshot | None, fresh: bool) -> None:
        self._beat += 1
        heading = live_heading(self._watcher.condition, self._watcher.age, self._info, report)
        self._heading.content = render("run.renewed_heading", heading, self._beat, SILENT_S)
        if self._info is None or report is None:
            return
        self._events.content = events_html(report)
        if report.cycle is not None:
            instant = Instant.of(self._info.rig, report.cycle)
            self.show_texts(
                self._info,
                report,
                instant,
                fresh,
                lambda html: render("run.renewed", html, self._beat, fresh, SILENT_S),
            )

    def is_abandoned(self) -> bool:
        """Return whether the run is over and no browser has shown it for `LINGER_S`."""
        now = time.perf_counter()
        if self._watcher.condition not in OVER or self.server.viser.get_clients() or self._stopping.locked():
            self._last_used = now
        return now - self._last_used > LINGER_S

    def close(self) -> None:
        """Close the page."""
        super().close()
        self._watcher.close()


def live_heading(condition: str, age: float, info: RunInfo | None, report: RunSnapshot | None) -> str:
    """Return the condition of a run as HTML, with its age in s where no newer cycle comes."""
    ended_well = report is not None and (
        report.ended in (DURATION_REACHED, DEMAND_STOPPED) or report.ended.startswith("signal")
    )
    return render("run.live_heading", condition, age, info, report, ended_well)


def events_html(report: RunSnapshot) -> str:
    """Return the latest events of a run in progress, the newest first."""
    return render("run.events", list(report.events)[: -SHOWN_EVENTS - 1 : -1])


def open_page() -> str:
    """Start a process with the page of what this process will run, which opens a browser; return the address.

    It ends when the run has ended and no browser shows it any more. HardwareError if it cannot be served.
    """
    published = publisher()
    if published is None:
        raise HardwareError("there is no free UDP port at 127.0.0.1, over which the view would follow the run")
    command = [sys.executable, "-P", "-m", "tensionlab.viewer.live"]  # -P: nothing of the working directory
    page = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **OWN_GROUP)
    _started.append(page)
    assert page.stdin is not None
    assert page.stdout is not None
    with suppress(OSError), page.stdin:  # if it has ended already, its answer says so
        page.stdin.write(json.dumps({"port": published.port, "token": published.token}) + "\n")
    with page.stdout:
        line = page.stdout.readline()
    answer = json.loads(line) if line else {"error": "its process has ended at once"}
    if "error" in answer:
        raise HardwareError(f"the view cannot be opened: {answer['error']}")
    return str(answer["url"])


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
        page.serve(page.is_abandoned)
    finally:
        page.close()


if __name__ == "__main__":
    main()
