import dataclasses
import itertools

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import Limit, State
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.plots import plot_run
from tensionlab.plots.run import LIMITER_LOOKS, severity
from tensionlab.solvers.base import Status
from tests.helpers import runs
from tests.helpers.figures import content_of, words_in


@pytest.fixture(scope="module")
def lossy(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.seven(), 100, lost=2)
    return read_run(file)


def test_the_same_run_makes_the_same_figure_which_names_what_is_in_it(lossy):
    content = content_of(plot_run(lossy))
    assert content == content_of(plot_run(lossy))
    words = words_in(content)
    names = [module.name for module in lossy.rig.modules]
    looks = ("status", "exact", "certified infeasible", "fault, or lost")
    for word in ("force (N)", "force error (N)", "tension (N)", "time (ms)", "time (s)", *looks, *names):
        assert word in words, word
    assert "torque (N·m)" not in words
    assert not any("the log was cut off" in word for word in words)
    assert f"lost {names[2]}" in words
    counts = [np.sum(lossy.status == status) for status in (Status.EXACT, Status.NEAREST)]
    title = "seven-modules, newton, nearest in force: 100 cycles at 50 Hz, {} exact, {} certified infeasible"
    assert title.format(*counts) in words
    assert "amplitude (N)" not in words  # no effect vibrates


def test_a_run_without_a_cycle_is_an_empty_picture(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 0)
    assert "no cycle in the log" in words_in(content_of(plot_run(read_run(tmp_path / "run.mcap"))))


def test_torques_have_a_panel_of_their_own_and_a_log_that_was_cut_off_says_so(tmp_path):
    runs.logged(tmp_path / "run.mcap", tl.load_rig(runs.RIGS / "kntu-planar.toml"), 5)
    cut = dataclasses.replace(read_run(tmp_path / "run.mcap"), complete=False)
    words = words_in(content_of(plot_run(cut)))
    assert "torque (N·m)" in words
    assert any("the log was cut off" in word for word in words)
    assert "fault, or lost" not in words


def test_in_a_long_run_nothing_is_overlooked(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 50)
    short = read_run(tmp_path / "run.mcap")
    many = {name: np.concatenate([getattr(short, name)] * 100) for name in COLUMNS}
    long = dataclasses.replace(short, **{**many, "time": np.arange(5000) / 50.0})
    long.faults[3335, 1] = 1
    assert "fault, or lost" in words_in(content_of(plot_run(long)))


def test_every_limiter_has_a_severity_and_a_lost_module_the_worst(lossy):
    limiters = [limit for _, _, limits in LIMITER_LOOKS for limit in limits]
    assert sorted(limiters) == sorted(Limit)
    levels, gone = severity(lossy), len(LIMITER_LOOKS)
    assert set(np.unique(levels)) == {0, 1, gone}
    assert (levels[50:, 2] == gone).all()
    assert (levels[:50, 2] != gone).all()
    broken = dataclasses.replace(lossy, states=np.full_like(lossy.states, State.ESTOP))
    assert (severity(broken) == gone).all()


def test_names_of_events_at_nearly_the_same_time_do_not_cover_each_other(lossy):
    end, names = float(lossy.time[-1]), [module.name for module in lossy.rig.modules]
    times = [0.4, 0.42, 0.45, 1.0, end - 0.02, end, end]
    events = [RunEvent(1, time, "lost", "", name) for time, name in zip(times, names, strict=True)]
    figure = plot_run(dataclasses.replace(lossy, events=(*events, RunEvent(2, end, "ended", ""))))
    figure.canvas.draw()
    named = [text for text in figure.axes[0].texts if text.get_text().startswith(("lost", "ended"))]
    boxes = [text.get_window_extent() for text in named]
    assert len(boxes) == len(events) + 1
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)
