"""How a run is played: pure functions of what is shown."""

import numpy as np
import pytest

from tensionlab.viewer import playback
from tensionlab.viewer.playback import Playback, cycle_at

STATE = Playback(1.0, 9.0, 4.0)


def test_time_passes_at_the_speed_that_is_chosen_and_stops_at_the_end():
    playing = playback.choose(speed=2.0)(playback.play(STATE))
    later = playback.advance(playing, 1.5)
    assert (later.time, later.playing) == (7.0, True)
    over = playback.advance(later, 1.5)
    assert (over.time, over.playing) == (9.0, False)
    assert playback.advance(over, 1.0) == over


def test_what_is_paused_stays():
    assert playback.advance(STATE, 1.0) == STATE
    paused = playback.pause(playback.play(STATE))
    assert playback.advance(paused, 1.0).time == 4.0


def test_at_the_end_it_is_played_again_from_the_begin():
    assert playback.play(playback.seek(STATE, 9.0)).time == 1.0
    assert playback.play(STATE).time == 4.0


@pytest.mark.parametrize(("time", "shown"), [(2.5, 2.5), (0.0, 1.0), (99.0, 9.0)])
def test_a_time_that_is_chosen_is_in_the_run_and_stops_there(time, shown):
    found = playback.seek(playback.play(STATE), time)
    assert (found.time, found.playing) == (shown, False)


def test_steps_go_to_the_next_event_and_back_and_nowhere_beyond_the_last():
    times = np.array([1.0, 4.0, 4.0, 6.0])
    ahead = playback.step(STATE, times, 1)
    assert ahead.time == 6.0
    assert playback.step(ahead, times, 1).time == 6.0
    back = playback.step(ahead, times, -1)
    assert back.time == 4.0
    assert playback.step(back, times, -1).time == 1.0
    assert playback.step(STATE, np.empty(0), -1).time == 4.0


def test_the_cycle_at_a_time_is_the_latest_that_has_begun():
    times = np.array([0.5, 1.0, 1.5])
    assert [cycle_at(times, time) for time in (0.0, 0.5, 0.99, 1.0, 7.0)] == [0, 0, 0, 1, 2]
