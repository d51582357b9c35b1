"""What the page of a run says."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tensionlab.demand import Demand
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.protocol.codes import BrakeState, Limit
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.sharing import RUN, RunInfo, RunSnapshot
from tensionlab.hardware.simulation.world import World
from tensionlab.support.colours import GREEN, GREY, ORANGE, RED
from tensionlab.viewer.html import render
from tensionlab.viewer.live import StopOutcome, events_html, live_heading
from tensionlab.viewer.run_page import modules_html
from tensionlab.viewer.run_scene import Instant
from tests.helpers.browsers import plain
from tests.helpers.runs import four

WELL = {"over": True, "ended": "duration reached", "lost": {}}  # end of a run
INFO = RunInfo(0, 4711, "tensionlab run <floor>", four(), "newton", 50.0, 0.25, {})


@pytest.fixture
def report(monkeypatch):
    """Return the report of a run in progress after 20 cycles, in which a module was lost after 10."""
    published = SimpleNamespace(topics={}, announce=lambda topic: None)
    monkeypatch.setattr(shared_telemetry, "_publisher", published)
    rows = []

    def demand(state):
        if state.cycle == 10:
            world.modules[1].damage("encoder")
        if state.cycle == 20:
            rows.append(json.loads(published.topics[RUN]()))
        return Demand(np.array([1.0, 2.0, 0.5]), brakes=frozenset({"top"}))

    world = World(four())
    settings = RunSettings(on_loss="continue")
    Runner(four(), world.group(), "newton", demand, settings, clock=WorldClock(world)).run(0.5)
    return RunSnapshot.unpack(rows[0], four())


def said(report):
    return plain(modules_html(INFO, report, Instant.of(INFO.rig, report.cycle)))


@pytest.mark.parametrize(
    ("condition", "info", "changes", "text", "colour"),
    [
        ("waiting", None, None, "WAITING for the run to answer", GREY),
        ("gone", None, None, "GONE Its process ended unexpectedly", RED),
        ("waiting", INFO, None, "WAITING for news of the run", GREY),
        ("arming", INFO, None, "ARMING modules are armed, and slack is taken up", ORANGE),
        ("gone", INFO, None, "GONE Its process ended unexpectedly", RED),
        ("live", INFO, {"lost": {}},
         "LIVE 0.4 s, 20 cycles at 50 Hz, newton process 4711: tensionlab run &lt;floor&gt;", GREEN),
        ("live", INFO, {}, "LIVE, 1 module lost 0.4 s", ORANGE),
        ("stale", INFO, {}, "STALE for 3.2 s no newer cycle has come; what is shown is old", RED),
        ("ended", INFO, WELL,
         "ENDED 20 cycles; all modules have confirmed that they stopped duration reached", GREY),
        ("ended", INFO, WELL | {"lost": {"top": "mute"}}, "ENDED 20 cycles; all modules have confirmed", RED),
        ("ended", INFO, WELL | {"ended": "RuntimeError: <b>"},
         "ENDED 20 cycles; all modules have confirmed that they stopped RuntimeError: &lt;b&gt;", RED),
        ("ended", INFO, WELL | {"ended": "signal 2", "emergency": True}, "ENDED", RED),
        ("ended", INFO, WELL | {"unconfirmed": {"top": "no answer"}},
         "ENDED 20 cycles duration reached top did not confirm that it stopped : no answer", RED),
    ],
)  # fmt: skip
def test_the_condition_of_a_run_is_said_in_its_colour(report, condition, info, changes, text, colour):
    html = live_heading(condition, 3.21, info, None if changes is None else replace(report, **changes))
    assert plain(html).startswith(text)
    assert f"solid {colour}" in html


def test_modules_have_tension_state_brake_limiter_link_and_faults(report):
    text = said(report)
    assert re.search(r"floor-1 \d\.\d\d N running · \d\.\d+ A · \d+ °C · brake open · .*link \d+ ms", text)
    assert re.search(r"floor-2 LOST fault · .* fault: encoder · module .* has released its cable", text)
    assert re.search(r"top \d.* brake open, commanded on|top \d.* brake closed|top \d.* brake closing", text)


def test_what_is_wrong_with_a_module_is_marked(report):
    cycle = dict(report.cycle)
    cycle["limiters"] = np.array([Limit.THERMAL, Limit.NONE, Limit.NONE, Limit.NONE])
    cycle["ages"] = np.array([0.08, 0.01, np.inf, 0.01])
    cycle["measured"] = np.array([2.0, 0.0, 0.1, np.nan])
    cycle["brake_states"] = np.array([BrakeState.CLOSED, -1, -1, -1])
    found = replace(report, cycle=cycle, bad_frames=np.array([0, 0, 0, 3]))
    text = said(found)
    assert "brake closed, commanded off · limited by thermal · link 80 ms" in text
    assert "link silent · slack" in text
    assert "top unknown last report: running" in text
    assert "3 damaged frames" in text
    html = modules_html(INFO, found, Instant.of(INFO.rig, cycle))
    for words in ("link 80 ms", "link silent", "slack", "fault: encoder"):
        assert f'<span style="color:{RED}">{words}</span>' in html
    assert f'<span style="color:{RED}">link 10 ms' not in html


def test_events_are_told_the_newest_first(report):
    text = plain(events_html(report))
    assert text.index("lost") < text.index("armed")
    odd = replace(report, events=(RunEvent(0, 0.5, "phase", "<b>draw</b>", ""),))
    assert plain(events_html(odd)) == "0.50 s phase &lt;b&gt;draw&lt;/b&gt;"
    assert plain(events_html(replace(report, events=()))) == "none yet"


def test_the_outcome_of_a_stop_is_told():
    text = render("run.stopped", StopOutcome(True, ("confirmed by 4 modules",)))
    assert plain(text) == "STOPPED confirmed by 4 modules"
    text = render("run.stopped", StopOutcome(False, ("top: <gone>", "confirmed by 3 modules")))
    assert plain(text).startswith("NOT STOPPED top: &lt;gone&gt; confirmed by 3 modules Cut the power")
    assert RED in text
