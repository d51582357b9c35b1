"""Events of a run, for its timeline."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.solvers.base import Status
from tensionlab.viewer.replay import GAP_S, KINDS, RunMark, marks, spells
from tests.helpers import runs


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.four(), 100)
    return read_run(file)


@pytest.fixture
def quiet(written):
    """A run in which nothing happens."""
    m = written.rig.m
    calm = np.zeros((100, m), np.int64)
    return replace(
        written, events=(), status=np.full(100, Status.EXACT, np.int8), faults=calm, limiters=calm,
        brake_states=calm, commanded_brakes=np.zeros((100, m), bool), fallback_used=np.zeros(100, bool),
    )  # fmt: skip


def during(first, last, value, quiet, name, module=None):
    """The run with a value of a column from one cycle to another."""
    changed = getattr(quiet, name).copy()
    changed[first : last + 1, *([] if module is None else [module])] = value
    return replace(quiet, **{name: changed})


def test_where_nothing_happens_there_are_no_marks(quiet):
    assert marks(quiet) == ()


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
    found = marks(during(10, 29, value, quiet, name, module))
    text = mark.text.format("" if module is None else quiet.rig.modules[module].name)
    assert found[0].time == pytest.approx(mark.time)
    assert (found[0].kind, found[0].text) == (mark.kind, text)
    assert len(found) == (2 if name == "faults" else 1)


def test_what_lasts_to_the_end_says_so(quiet):
    [found] = marks(during(90, 99, Status.NEAREST, quiet, "status"))
    assert found.text == "NEAREST, to the end"


def test_noted_events_have_the_kind_of_phases_brakes_or_the_run(quiet):
    noted = (
        RunEvent(-1, 0.0, "armed", "4 modules", ""),
        RunEvent(5, 0.1, "phase", "draw", ""),
        RunEvent(6, 0.12, "brake", "contact: top", ""),
        RunEvent(9, 0.18, "lost", "it is silent", "top"),
    )
    found = marks(replace(quiet, events=noted[::-1]))
    assert [(mark.kind, mark.text) for mark in found] == [
        ("run", "armed: 4 modules"), ("phase", "draw"),
        ("brake", "contact: top"), ("run", "lost: top: it is silent"),
    ]  # fmt: skip


def test_the_marks_of_a_real_run_are_in_order_and_of_known_kinds(written):
    found = marks(written)
    assert {mark.kind for mark in found} <= set(KINDS)
    assert [mark.time for mark in found] == sorted(mark.time for mark in found)
    assert {"run", "limiter", "brake"} <= {mark.kind for mark in found}


def test_short_gaps_do_not_end_a_spell():
    time = 0.1 * np.arange(20)
    short, long = round(GAP_S / 0.1 - 0.5), round(GAP_S / 0.1 + 1.5)
    flags = np.full(20, True)
    flags[5 : 5 + short] = False
    assert spells(time, flags) == [(0, 19)]
    flags[10 : 10 + long] = False
    assert spells(time, flags) == [(0, 9), (10 + long, 19)]
    assert spells(time, np.zeros(20, bool)) == []
