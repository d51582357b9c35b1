"""What the page of a log says."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tensionlab.hardware.log.reader import read_run
from tensionlab.solvers.base import Status
from tensionlab.support.colours import GREEN, ORANGE
from tensionlab.viewer import replay_words
from tensionlab.viewer.instant import BESIDE_COLOUR
from tensionlab.viewer.playback import Playback
from tensionlab.viewer.recorded import answer_at
from tensionlab.viewer.run_marks import KINDS, Band, Mark
from tests.helpers import runs


def plain(text):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text)).strip()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.four(), 100)
    return read_run(file)


STATE = Playback(0.0, 1.98, 0.5)


def test_the_heading_says_the_status_and_where_in_the_run_it_is(run):
    text = replay_words.heading(run, STATE, 25)
    assert plain(text) == "EXACT the desired force is rendered 0.50 s of 1.98 s, cycle 25 at 50 Hz, newton"
    assert GREEN in text


def test_the_heading_says_what_was_not_as_it_should_be(run):
    status = run.status.copy()
    status[25] = Status.NEAREST
    text = replay_words.heading(replace(run, status=status, complete=False), STATE, 25)
    assert plain(text).startswith("NEAREST certified infeasible")
    assert "cut off: the log was never closed" in text
    assert ORANGE in text
    assert plain(replay_words.heading(run, STATE, 49)).startswith("NO FORCE no force is desired")
    fallback = replace(run, fallback_used=np.full(100, True))
    assert "newton left it unproven: newton's answer was sent" in replay_words.heading(fallback, STATE, 25)


def test_the_timeline_has_marks_phases_and_the_time_that_is_shown_where_they_are():
    phases = [Band("draw", 0.0, 2.0, 0), Band("<full>", 1.0, 2.0, 1)]
    marks = [Mark(1.5, "fault", "top: ENCODER")]
    text = replay_words.timeline(Playback(0.0, 2.0, 0.5), marks, phases, "<svg/>")
    assert f"left:calc(75.00% - 1px);width:2px;height:12px;background:{KINDS['fault']}" in text
    assert "left:50.00%;top:15px;width:calc(50.00% - 2px)" in text
    assert "left:calc(25.000% - 1px)" in text
    assert plain(text) == "draw &lt;full&gt;"


def test_curves_are_to_one_scale_and_broken_where_there_is_no_force(run):
    text = replay_words.curves(run)
    desired, measured = re.findall(r'<path d="([^"]*)"', text)
    assert desired.count("M") == 2  # none is desired in cycles 49 and 99
    heights = [float(each) for each in re.findall(r"[ML][\d.]+ ([\d.]+)", desired + measured)]
    assert min(heights) == pytest.approx(0.04, abs=1e-3)
    assert max(heights) <= 1.0


def test_a_run_without_any_force_has_a_timeline_too(run):
    nothing = replace(run, desired=run.desired * np.nan, measured=run.measured * np.nan)
    assert 'd=""' in replay_words.curves(nothing)


def test_events_are_those_around_the_time_and_the_latest_is_marked():
    marks = [Mark(float(i), "limiter", f"<event {i}>") for i in range(40)]
    text = replay_words.events(marks, 20.4)
    assert [int(each) for each in re.findall(r"event (\d+)", text)] == list(range(13, 27))
    [row] = [row for row in text.split("<tr") if ".25" in row.partition(">")[0]]
    assert "&lt;event 20&gt;" in row
    assert "those around 20.40 s; 26 events more" in plain(text)
    assert plain(replay_words.events([], 1.0)) == "There are none."
    assert "background" not in replay_words.events(marks[3:5], 1.0)  # none has been yet


def test_another_solver_is_beside_what_was_done(run):
    found = answer_at(run, 25, "closed-form")
    text = replay_words.answer(run, 25, "closed-form", found)
    assert BESIDE_COLOUR in text
    words = plain(text)
    assert words.startswith("the run exact error 0 N closed-form exact error 0 N difference of force 0 N")
    assert "module newton sent closed-form difference" in words
    apart = found.tensions[0] - run.chosen[25, 0]
    assert abs(apart) > 1e-3
    assert f"{apart:.3g}" in words
    assert plain(replay_words.answer(run, 49, "closed-form", None)) == "No force was desired: no solver was asked."
