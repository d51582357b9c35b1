"""The page of a log: instants, events, how it is played, and once in a real browser with a real log."""

import re
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import LogError
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.solvers.base import Status
from tensionlab.viewer import replay
from tensionlab.viewer.html import render
from tensionlab.viewer.replay import RunMark
from tensionlab.viewer.server import PageServer
from tests.helpers import runs
from tests.helpers.browsers import HANGS_S, chromium, needs_browser, until
from tests.helpers.simulated_time import SimulatedTime

AT_4 = replay.Playback(1.0, 9.0, 4.0)


def test_time_passes_at_the_chosen_speed_and_stops_at_the_end():
    playing = replace(AT_4, speed=2.0).play()
    later = playing.advance(1.5)
    assert (later.time, later.playing) == (7.0, True)
    over = later.advance(1.5)
    assert (over.time, over.playing) == (9.0, False)
    assert over.advance(1.0) == over
    assert over.play().time == 1.0  # from the begin again
    assert AT_4.advance(1.0) == AT_4
    for time, shown in ((2.5, 2.5), (0.0, 1.0), (99.0, 9.0)):
        chosen = playing.seek(time)
        assert (chosen.time, chosen.playing) == (shown, False)


def test_steps_go_to_the_next_event_and_back_and_nowhere_beyond_the_last():
    times = np.array([1.0, 4.0, 4.0, 6.0])
    ahead = AT_4.step(times, 1)
    assert (ahead.time, ahead.step(times, 1).time) == (6.0, 6.0)
    back = ahead.step(times, -1)
    assert (back.time, back.step(times, -1).time) == (4.0, 1.0)
    assert AT_4.step(np.empty(0), -1).time == 4.0


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    """A run of four modules, without a desired force in cycles 49 and 99."""
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.four(), 100)
    return read_run(file)


def test_curves_are_to_one_scale_and_broken_where_there_is_no_force(four):
    (desired, measured), most = [path for _, _, path in replay.curves(four)[0]], replay.curves(four)[1]
    assert desired.count("M") == 2
    heights = [float(height) for height in re.findall(r"[ML][\d.]+ ([\d.]+)", desired + measured)]
    assert min(heights) == pytest.approx(0.04, abs=1e-3)
    assert max(heights) <= 1.0
    assert most == pytest.approx(np.nanmax(np.linalg.norm(four.desired, axis=1)), rel=0.5)
    text = render("run.timeline", [], 1.0, [(0.75, replay.KINDS["fault"])], 0.25)
    assert re.search(rf'x1="0.7500" x2="0.7500" .* stroke="{replay.KINDS["fault"]}"', text)
    assert 'x1="0.25000" x2="0.25000"' in text
    nothing = replace(four, desired=four.desired * np.nan, measured=four.measured * np.nan)
    assert replay.curves(nothing)[0][0][2] == ""


@pytest.fixture
def quiet(four):
    """A run in which nothing happens."""
    m = four.rig.m
    calm = np.zeros((100, m), np.int64)
    return replace(
        four, events=(), status=np.full(100, Status.EXACT, np.int8), faults=calm, limiters=calm,
        brake_states=calm, commanded_brakes=np.zeros((100, m), bool), fallback_used=np.zeros(100, bool),
    )  # fmt: skip


def during(first, last, value, quiet, name, module=None):
    """The run with a value of a column from one cycle to another."""
    changed = getattr(quiet, name).copy()
    changed[first : last + 1, *([] if module is None else [module])] = value
    return replace(quiet, **{name: changed})


@pytest.mark.parametrize(
    ("name", "value", "module", "mark"),
    [
        ("status", Status.NEAREST, None, RunMark(0.2, "status", "NEAREST, for 0.40 s")),
        ("fallback_used", True, None, RunMark(0.2, "status", "unproven: newton's answer was sent, for 0.40 s")),
        ("faults", Fault.ENCODER | Fault.LOOP, 1, RunMark(0.2, "fault", "{}: ENCODER, for 0.40 s")),
        ("limiters", Limit.THERMAL, 2, RunMark(0.2, "limiter", "{}: THERMAL, for 0.40 s")),
        ("commanded_brakes", True, 3, RunMark(0.2, "brake", "{}: brake commanded on, for 0.40 s")),
        ("brake_states", BrakeState.CLOSED, 3, RunMark(0.2, "brake", "{}: brake closed, for 0.40 s")),
    ],
)
def test_what_lasts_has_a_mark_at_its_begin(quiet, name, value, module, mark):
    found = replay.marks(during(10, 29, value, quiet, name, module))
    text = mark.text.format("" if module is None else quiet.rig.modules[module].name)
    assert found[0].time == pytest.approx(mark.time)
    assert (found[0].kind, found[0].text) == (mark.kind, text)
    assert len(found) == (2 if name == "faults" else 1)
    assert replay.marks(during(90, 99, value, quiet, name, module))[0].text.endswith(", to the end")


def test_noted_events_have_the_kind_of_phases_brakes_or_the_run(quiet):
    noted = (
        RunEvent(-1, 0.0, "armed", "4 modules", ""),
        RunEvent(5, 0.1, "phase", "draw", ""),
        RunEvent(6, 0.12, "brake", "contact: top", ""),
        RunEvent(9, 0.18, "lost", "it is silent", "top"),
    )
    found = replay.marks(replace(quiet, events=noted[::-1]))
    assert [(mark.kind, mark.text) for mark in found] == [
        ("run", "armed: 4 modules"), ("phase", "draw"),
        ("brake", "contact: top"), ("run", "lost: top: it is silent"),
    ]  # fmt: skip


def test_the_marks_of_a_real_run_are_in_order_and_of_known_kinds(four, quiet):
    assert replay.marks(quiet) == ()
    found = replay.marks(four)
    assert {"run", "limiter", "brake"} <= {mark.kind for mark in found} <= set(replay.KINDS)
    assert [mark.time for mark in found] == sorted(mark.time for mark in found)


def test_short_gaps_do_not_end_a_spell():
    time = 0.1 * np.arange(20)
    short, long = round(replay.GAP_S / 0.1 - 0.5), round(replay.GAP_S / 0.1 + 1.5)
    flags = np.full(20, True)
    flags[5 : 5 + short] = False
    assert replay.spells(time, flags) == [(0, 19)]
    flags[10 : 10 + long] = False
    assert replay.spells(time, flags) == [(0, 9), (10 + long, 19)]
    assert replay.spells(time, np.zeros(20, bool)) == []


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.seven(), 120, solver="dykstra", lost=2)
    return read_run(file)


def test_an_instant_has_what_the_cycle_had(recorded):
    instant = replay.instant_at(recorded, 70)
    assert instant.time == recorded.time[70]
    assert instant.hand == pytest.approx(recorded.position[70])
    assert instant.anchors == pytest.approx(recorded.rig.anchors)
    assert instant.tensions == pytest.approx(recorded.measured[70])
    assert instant.desired == pytest.approx(recorded.desired[70])
    assert instant.active.tolist() == [True, True, False, True, True, True, True]
    first = replay.instant_at(recorded, 0)  # before the first telemetry
    assert np.isnan(recorded.measured[0]).all()
    assert np.isnan(first.tensions).all(), "what was sent is not shown as measured"
    assert np.isnan(first.measured).all()


def test_a_report_knows_what_had_happened_until_then(recorded):
    name = recorded.rig.modules[2].name
    before, after = replay.report_at(recorded, 59), replay.report_at(recorded, 60)
    assert (before.lost, before.cycles, [event.kind for event in before.events]) == ({}, 60, ["armed"])
    assert set(after.lost) == {name}
    assert [event.kind for event in after.events] == ["armed", "lost"]
    end = replay.report_at(recorded, 119)
    assert end.answers == tl.hardware.log.reader.recount(recorded).answers
    assert end.start_delays.tolist() == recorded.start_delay.tolist()
    late = replace(recorded, time=recorded.time + np.where(np.arange(120) >= 50, 3 / recorded.setup.rate, 0.0))
    late = replace(late, start_delay=np.zeros(120))
    assert [replay.report_at(late, cycle).missed for cycle in (49, 50, 119)] == [0, 3, 3]
    info = replay.info_of(recorded)
    assert (info.program, info.solver, info.rate, info.rig) == ("tensionlab run", "dykstra", 50.0, recorded.rig)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda run: {"time": np.empty(0), "cycle": np.empty(0)}, "ended before its first cycle"),
        (lambda run: {"time": run.time[::-1]}, "not in the order of time"),
        (lambda run: {"position": run.position * np.nan}, "in cycle 0 it is not known where the hand"),
        (lambda run: {"anchors": run.anchors * np.nan}, "where the hand and all anchors are"),
    ],
)
def test_a_run_of_which_nothing_can_be_drawn_is_refused_with_the_name_of_its_file(recorded, change, message):
    replay.require_drawable(recorded, "good.mcap")
    with pytest.raises(LogError, match=rf"bad\.mcap: .*{message}"):
        replay.require_drawable(replace(recorded, **change(recorded)), "bad.mcap")


def test_picture_and_texts_follow_the_time_that_is_chosen(recorded, monkeypatch):
    passing = SimulatedTime()
    monkeypatch.setattr(replay, "time", passing)
    page = replay.ReplayPage(recorded, PageServer())

    def change(change, seconds):
        page.change(change)
        passing.sleep(seconds)
        page.turn()

    try:
        assert "LOST" not in page._modules.content
        change(lambda now: now.seek(1.3), 0.1)
        assert page.index == 65
        assert page._modules.content.count("LOST") == 1
        assert "cycle 65 at 50 Hz" in page._heading.content
        assert page._slider.value == 1.3
        change(lambda now: replace(now, speed=0.5).play(), 0.0)
        change(lambda now: now, 0.4)
        assert page.playback.time == pytest.approx(1.5)
        change(lambda now: now, 60.0)
        assert (page.playback.time, page.playback.playing) == (recorded.time[-1], False)
    finally:
        page.close()


@pytest.mark.slow
@needs_browser
def test_a_log_is_scrubbed_and_played_in_a_browser(recorded):
    status = np.where(recorded.time < 0.6, Status.EXACT, Status.NEAREST).astype(np.int8)
    page = replay.ReplayPage(replace(recorded, status=status), PageServer())
    try:
        with chromium() as browser:
            tab = browser.new_page(viewport={"width": 960, "height": 600})
            tab.set_default_timeout(1000.0 * HANGS_S)
            tab.goto(page.server.url)

            def sees(text, opened_by=None):
                """Wait until the page shows a text, while it is served; one click may be lost."""

                def there():
                    page.turn()
                    if opened_by:
                        opened_by.click()
                    tab.wait_for_timeout(20.0)
                    return tab.get_by_text(text).count()

                until(there, text)

            sees("EXACT")
            time = tab.locator("//*[normalize-space(text())='time s']/following::input[not(@type='hidden')][1]")
            time.fill("0.400")
            time.press("Enter")
            sees("cycle 20 at 50 Hz")
            sees(f"{recorded.measured[20, -1]:.2f} N")
            tab.get_by_role("button", name="Play", exact=True).click()
            sees("NEAREST")  # played, after 0.6 s
            tab.get_by_role("button", name="Previous event", exact=True).click()
            sees("NEAREST, ", tab.get_by_role("tab", name="Events"))
    finally:
        page.close()
