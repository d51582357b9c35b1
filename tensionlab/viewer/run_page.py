"""The page of a run, in progress or from its log: one picture, and the same texts next to it."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.sharing import POLL_S, RunInfo, RunSnapshot
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS
from tensionlab.support.formatting import format_count, format_number
from tensionlab.viewer.html import norm, render, vector
from tensionlab.viewer.run_scene import ENLARGED, Instant, SceneryDrawing, draw_instant, points_to_see
from tensionlab.viewer.scene import RigDrawing, force_scale
from tensionlab.viewer.server import PageServer, lay_out

SHOWN_EVENTS = 20  # number of latest events that are shown of a run in progress
DECIMALS = 3  # decimals of components in N: a text that changes its length from cycle to cycle cannot be read
LATE_PERIODS = 3.0  # age of telemetry, in cycles, from which on it is marked


class RunDrawing:
    """Nodes of the scene of a run: its rig, and the surroundings of its scenario."""

    def __init__(
        self, server: Any, rig: Rig, instant: Instant, scenery: Scenery | None, covered: float = 0.0
    ) -> None:
        """Look at all that is there at an instant, but for the share ``covered`` of the picture, from below."""
        self._rig, self._scenery = rig, None
        points = [instant.anchors, instant.hand[None]]
        if scenery is not None:
            points.append(points_to_see(scenery, rig, instant)[:, : rig.dimension])
            self._scenery = SceneryDrawing(server.scene, scenery, rig, instant)
        self._drawing = RigDrawing(server, FORCE_COLOURS)
        self._drawing.look_at(rig, *points, covered=covered)

    def show(self, instant: Instant, *, fresh: bool = True) -> None:
        """Bring all nodes up to date; an instant that is not fresh is grey."""
        self._drawing.show(draw_instant(self._rig, instant, fresh=fresh))
        if self._scenery is not None:
            self._scenery.show(instant, fresh=fresh)


class RunPage(ABC):
    """Page of a run in the browser.

    Call `turn` some thirty times a second, in one thread; `serve` does.
    """

    scenery: Scenery | None = None

    def __init__(self, server: PageServer) -> None:
        self.server = server
        gui = server.viser.gui
        lay_out(gui)
        gui.add_html(render("run.animations"))
        self._outcome, self._heading, self._phases, self._forces = (gui.add_html("") for _ in range(4))
        self._tabs = gui.add_tab_group()
        with self._tabs.add_tab("Modules"):
            self._modules = gui.add_html("")
        with self._tabs.add_tab("Events"):
            self._events = gui.add_html("")
        with self._tabs.add_tab("Loop"):
            self._times = gui.add_html("")

    @abstractmethod
    def turn(self) -> None:
        """Take what is new, and bring all browsers up to date."""

    def show_texts(
        self,
        info: RunInfo,
        report: RunSnapshot,
        instant: Instant,
        *,
        fresh: bool,
        wrap: Callable[[str], str] = str,
    ) -> None:
        """Bring the texts about a report and its instant up to date, each wrapped by a function."""
        for part, html in (
            (self._phases, render("run.phases", self.scenery, instant.time)),
            (self._forces, forces_html(info.rig, instant)),
            (self._modules, modules_html(info, report, instant, fresh=fresh)),
            (self._times, times_html(info, report)),
        ):
            part.content = wrap(html)

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
    d = rig.dimension
    lines = [(name, colour, *_force(getattr(instant, name), d)) for name, colour in FORCE_COLOURS.items()]
    if np.isfinite(instant.desired).all():
        lines.append(("measured − desired", "", *_force(instant.measured - instant.desired, d)))
    newtons = 1.0 / (ENLARGED * force_scale(rig))
    return render("run.forces", lines, newtons, "; vectors in N and N·m" if rig.n > d else "")


def _force(wrench: Floats, d: int) -> tuple[str, str]:
    """Return the size of the force and the components of a wrench; only pretension where none is desired."""
    if not np.isfinite(wrench).all():
        return "–", "pretension only"
    rounded = np.round(wrench, DECIMALS)
    return f"{norm(rounded[:d])} N", vector(rounded)


def modules_html(info: RunInfo, report: RunSnapshot, instant: Instant, *, fresh: bool = True) -> str:
    """Return each module's tension as a bar with its set-point, and its state below."""
    assert report.cycle is not None
    rig = info.rig
    colours, slack = instant.colours(rig, fresh=fresh), instant.slack(rig)
    lines = []
    for i, module in enumerate(rig.modules):
        state, faults = _state(info, report, report.cycle, i)
        faults = [*faults, "slack"] if slack[i] else faults
        lines.append({
            "name": module.name,
            "tension": float(instant.tensions[i]),
            "colour": colours[i],
            "marks": [(float(instant.set_points[i]), BLUE)],
            "value": f"{format_number(float(instant.tensions[i]))} N" if instant.active[i] else "LOST",
            "warn": bool(slack[i]) or not instant.active[i],
            "state": state,
            "faults": faults,
        })  # fmt: skip
    return render("run.modules", lines, float(rig.limits.upper.max()) or 1.0)


def _state(info: RunInfo, report: RunSnapshot, cycle: Mapping[str, Any], i: int) -> tuple[list[str], list[str]]:
    """Return the state of a module: driver, brake and limiter; and what is wrong with it."""
    texts = [State(int(cycle["states"][i])).name.lower()]
    if np.isfinite(report.currents[i]):
        texts.append(f"{format_number(float(report.currents[i]))} A")
    texts.append(f"heat {100 * float(np.nan_to_num(cycle['thermal'][i])):.0f} %")
    brake, commanded = int(cycle["brake_states"][i]), bool(cycle["commanded_brakes"][i])
    if brake >= 0:
        as_commanded = commanded is (brake == BrakeState.CLOSED)
        differs = "" if as_commanded else f", commanded {'on' if commanded else 'off'}"
        texts.append(f"brake {BrakeState(brake).name.lower()}{differs}")
    limiter = Limit(int(cycle["limiters"][i]))
    if limiter is not Limit.NONE:
        texts.append(f"limited by {limiter.name.lower()}")
    age = float(cycle["ages"][i])
    link = f"link {1e3 * age:.0f} ms" if np.isfinite(age) else "link silent"
    faults = [link] if age * info.rate > LATE_PERIODS else []
    if not faults:
        texts.append(link)
    if bad := int(report.bad_frames[i]):
        texts.append(format_count(bad, "damaged frame"))
    faults += [f"fault: {(fault.name or '').lower()}" for fault in Fault(int(cycle["faults"][i]))]
    if why := report.lost.get(info.rig.modules[i].name):
        faults.append(why)
    return texts, faults


def times_html(info: RunInfo, report: RunSnapshot) -> str:
    """Return the latency of the loop, and the times of the latest cycles."""
    latency = None
    if report.cycle is not None:
        delays = report.cycle["delays"][report.cycle["active"]]
        latency = float(np.nanmax(delays)) if np.isfinite(delays).any() else float("nan")
    quantiles = [
        (name, *(float(value) for value in np.percentile(values, [50.0, 99.0])))
        for name, values in (("start jitter", report.start_delays), ("compute time", report.compute_times))
        if len(values)
    ]
    return render("run.times", latency, quantiles, report.missed, report.answers, 1.0 / info.rate)


def events_html(report: RunSnapshot) -> str:
    """Return the latest events of a run in progress, the newest first."""
    newest = list(report.events)[: -SHOWN_EVENTS - 1 : -1]
    return render("run.events", newest)
