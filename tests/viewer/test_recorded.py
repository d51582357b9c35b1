"""A run from its log, as it was at each instant."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import LogError
from tensionlab.hardware.log.reader import read_run
from tensionlab.viewer.replay import info_of, instant_at, report_at, require_drawable
from tests.helpers import runs


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.seven(), 120, solver="dykstra", lost=2)
    return read_run(file)


def test_an_instant_has_what_the_cycle_had(run):
    instant = instant_at(run, 70)
    assert instant.time == run.time[70]
    assert instant.hand == pytest.approx(run.position[70])
    assert instant.anchors == pytest.approx(run.rig.anchors)
    assert instant.tensions == pytest.approx(run.measured[70])
    assert instant.desired == pytest.approx(run.desired[70])
    assert instant.active.tolist() == [True, True, False, True, True, True, True]


def test_before_the_first_telemetry_cables_have_the_tension_that_was_sent(run):
    assert np.isnan(run.measured[0]).all()
    instant = instant_at(run, 0)
    assert instant.tensions == pytest.approx(run.commanded[0])
    assert not instant.measured.any()  # what was not measured is not shown as measured


def test_a_report_knows_what_had_happened_until_then(run):
    name = run.rig.modules[2].name
    before, after = report_at(run, 59), report_at(run, 60)
    assert (before.lost, before.cycles, [event.kind for event in before.events]) == ({}, 60, ["armed"])
    assert set(after.lost) == {name}
    assert [event.kind for event in after.events] == ["armed", "lost"]
    end = report_at(run, 119)
    assert end.answers == tl.hardware.log.reader.recount(run).answers
    assert end.start_delays.tolist() == run.start_delay.tolist()


def test_missed_deadlines_are_counted_until_then(run):
    late = replace(run, time=run.time + np.where(np.arange(120) >= 50, 3 / run.setup.rate, 0.0))
    late = replace(late, start_delay=np.zeros(120))
    assert (report_at(late, 49).missed, report_at(late, 50).missed, report_at(late, 119).missed) == (0, 3, 3)


def test_the_setup_is_that_of_the_log(run):
    info = info_of(run)
    assert (info.program, info.solver, info.rate) == ("tensionlab run", "dykstra", 50.0)
    assert info.rig == run.rig


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda run: {"time": np.empty(0), "cycle": np.empty(0)}, "ended before its first cycle"),
        (lambda run: {"time": run.time[::-1]}, "not in the order of time"),
        (lambda run: {"position": run.position * np.nan}, "in cycle 0 it is not known where the hand"),
        (lambda run: {"anchors": run.anchors * np.nan}, "where the hand and all anchors are"),
    ],
)
def test_a_run_of_which_nothing_can_be_drawn_is_refused_with_the_name_of_its_file(run, change, message):
    require_drawable(run, "good.mcap")
    with pytest.raises(LogError, match=rf"bad\.mcap: .*{message}"):
        require_drawable(replace(run, **change(run)), "bad.mcap")
