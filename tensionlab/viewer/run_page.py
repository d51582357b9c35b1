"""The page of a run, in progress or from its log: one picture, and the same texts next to it."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from tensionlab.hardware.runner.records import ROUNDING_S
from tensionlab.hardware.sharing import POLL_S, RunInfo, RunSnapshot
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery
from tensionlab.support.colours import FORCE_COLOURS
from tensionlab.viewer.html import render
from tensionlab.viewer.run_scene import ENLARGED, Instant
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.server import PageServer

DECIMALS = 3  # decimals of components in N: a text that changes its length from cycle to cycle cannot be read
LATE_PERIODS = 3.0  # age of telemetry, in cycles, from which on it is marked


class RunPage(ABC):
    """Page of a run in the browser.

    Call `turn` some thirty times a second, in one thread; `serve` does.
    """

    scenery: Scenery | None = None

    def __init__(self, server: PageServer) -> None:
        self.server = server
        gui = server.viser.gui
        gui.add_html(render("run.animations"))
        self._outcome, self._heading, self._phases, self._forces = (gui.add_html("") for _ in range(4))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Modules"):
            self._modules = gui.add_html("")
        with tabs.add_tab("Events"):
            self._events = gui.add_html("")
        with tabs.add_tab("Loop"):
            self._times = gui.add_html("")

    @abstractmethod
    def turn(self) -> None:
        """Take what is new, and bring all browsers up to date."""

    def show_texts(
        self, info: RunInfo, report: RunSnapshot, instant: Instant, fresh: bool, wrap: Callable[[str], str] = str
    ) -> None:
        """Bring the texts about a report and its instant up to date, each wrapped by a function."""
        self._phases.content = wrap(render("run.phases", self.scenery, instant.time))
        self._forces.content = wrap(forces_html(info.rig, instant))
        self._modules.content = wrap(modules_html(info, report, instant, fresh=fresh))
        self._times.content = wrap(times_html(info, report))

    def serve(self, until: Callable[[], bool]) -> None:
        """Show the run until a function, called in each turn, returns true."""
        while not until():
            self.turn()
            time.sleep(POLL_S)

    def close(self) -> None:
        """Close the page."""
        self.server.close()


def forces_html(rig: Rig, instant: Instant) -> str:
    """Return desired, commanded and measured wrench, and the error."""
    wrenches = {name: getattr(instant, name) for name in FORCE_COLOURS}
    if np.isfinite(instant.desired).all():
        wrenches["measured − desired"] = instant.measured - instant.desired
    rounded = {name: np.round(wrench, DECIMALS) for name, wrench in wrenches.items()}
    return render("run.forces", rounded, rig.dimension, 1.0 / (ENLARGED * force_scale(rig)))


def modules_html(info: RunInfo, report: RunSnapshot, instant: Instant, *, fresh: bool = True) -> str:
    """Return each module's tension as a bar with its set-point, and its state below."""
    colours, slack = instant.colours(info.rig, fresh=fresh), instant.slack(info.rig)
    return render("run.modules", info, report, instant, colours, slack, LATE_PERIODS / info.rate)


def times_html(info: RunInfo, report: RunSnapshot) -> str:
    """Return the latency of the loop, and the times of the latest cycles."""
    latency = None
    if report.cycle is not None:
        delays = report.cycle["delays"][report.cycle["active"]]
        latency = float(np.nanmax(delays)) if np.isfinite(delays).any() else float("nan")
    times = {"start jitter": report.start_delays, "compute time": report.compute_times}
    measured = {name: values for name, values in times.items() if max(values, default=0.0) > ROUNDING_S}
    quantiles = {name: np.percentile(values, [50.0, 99.0]) for name, values in measured.items()}
    return render("run.times", latency, quantiles, report.missed, report.answers, 1.0 / info.rate)
