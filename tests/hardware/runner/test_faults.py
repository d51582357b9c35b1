"""What can go wrong in a run, and that all tensions are then at the minimum or off within ttl and a cycle.

In lockstep, where time is exact; `test_fault_processes.py` has what takes real processes.
"""

import json
import signal
from dataclasses import dataclass

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Demand, measured_wrench
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, LogError, ModuleFault
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import Code, Fault, Limit, State
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.hardware.sharing import RunSnapshot, SharedRun
from tensionlab.hardware.simulation.world import simulated_module
from tensionlab.solvers.base import Status
from tensionlab.support.operating_system import ESTOP_SIGNAL
from tests.helpers.rehearsal import GENTLE, TROUBLE, Rehearsal
from tests.helpers.runs import EventList, new_log

TTL, CYCLE = 0.25, 0.02
TAUT = 0.5


@pytest.fixture
def rehearsal():
    return Rehearsal(tl.load_rig("bartels2026-validation"))


@pytest.fixture
def cube():
    """A rig of eight cables, and the name of its first module."""
    made = Rehearsal(tl.load_rig("cube-8"))
    return made, made.rig.modules[0].name


def assert_released(rehearsal):
    """All tensions are at the minimum tension, or off, at ttl and a cycle after the trouble, and stay so."""
    end = rehearsal.trouble_at + TTL + CYCLE
    assert rehearsal.world.time <= end
    assert rehearsal.let_pass(end) <= TAUT + 1e-6
    assert rehearsal.let_pass(end + 3.0) == 0.0


def test_a_cut_link_stops_all(rehearsal):
    runner = rehearsal.runner(rehearsal.demand(trouble=rehearsal.links["top"].cut))
    with pytest.raises(LinkError, match="it was cut"):
        runner.run(2.0)
    assert list(runner.statistics.lost) == ["top"]
    assert list(runner.statistics.unconfirmed) == ["top"]
    assert_released(rehearsal)


def test_silence_stops_all(rehearsal):
    runner = rehearsal.runner(rehearsal.demand(trouble=rehearsal.links["top"].freeze))
    with pytest.raises(LinkTimeout, match=r'module "top" at sim: has been silent for 0\.2'):
        runner.run(2.0)
    # The end waits for it, and then its time is over; the others were stopped before.
    assert rehearsal.let_pass(0.0) == 0.0
    assert rehearsal.states() == {"floor-1": "IDLE", "floor-2": "IDLE", "floor-3": "IDLE", "top": "TIMEOUT"}


def test_modules_that_never_report_are_named_after_two_seconds(rehearsal, monkeypatch):
    runner, began = rehearsal.runner(rehearsal.demand()), rehearsal.world.time
    prepare = runner.modules.prepare
    monkeypatch.setattr(runner.modules, "prepare", lambda rig, telemetry_ms: prepare(rig, 0))
    with pytest.raises(LinkTimeout, match=r"no telemetry from .*top within 2 s"):
        runner.run(2.0)
    assert rehearsal.world.time - began == pytest.approx(2.0, abs=0.2)


def test_a_module_that_starts_anew_stops_all(rehearsal):
    def reboot():
        index = list(rehearsal.links).index("top")
        old = rehearsal.world.modules[index]
        new = simulated_module(rehearsal.rig.modules[index], old.sample.length, serial_number=4)
        new.advance(old.seconds - new.seconds)  # the link's clock is this module's, and does not go back
        rehearsal.links["top"].inner.module = new
        rehearsal.world.modules = (*rehearsal.world.modules[:index], new, *rehearsal.world.modules[index + 1 :])

    with pytest.raises(ModuleFault) as caught:
        rehearsal.runner(rehearsal.demand(trouble=reboot)).run(2.0)
    assert caught.value.module == "top"
    assert caught.value.code in (Code.BAD_STATE, Code.BAD_SESSION, State.IDLE)
    assert_released(rehearsal)


@pytest.mark.parametrize(("part", "fault"), [("encoder", Fault.ENCODER), ("supply", Fault.SUPPLY)])
def test_a_fault_of_one_stops_all(rehearsal, part, fault):
    runner = rehearsal.runner(rehearsal.demand(trouble=lambda: rehearsal.module("floor-2").damage(part)))
    with pytest.raises(ModuleFault, match='module "floor-2" has released its cable') as caught:
        runner.run(2.0)
    assert caught.value.code == fault
    assert_released(rehearsal)


@pytest.mark.parametrize("force", [2.2, 5.0])
def test_a_module_that_gets_warm_is_asked_for_less_before_it_has_to_pull_less(rehearsal, force):
    """The published rig's top module alone pulls up: no other can relieve it."""
    rehearsal.trouble_at = 1e9
    for client in rehearsal.group.clients:
        client.set_parameter("winding_capacity", 1.0)
        client.set_parameter("housing_capacity", 1.0)
    runner = rehearsal.runner(rehearsal.demand(np.array([0.0, force, 0.0])))
    statistics = runner.run(16.0)
    assert statistics.ended == "duration reached"
    limits = np.array([state.limiters for state in rehearsal.cycles])
    assert not (limits == Limit.THERMAL).any()  # the host is always before the module
    uppers = np.array([state.upper_now[3] for state in rehearsal.cycles])
    assert np.abs(np.diff(uppers)).max() <= 0.11  # no jump that a hand would feel
    assert uppers[-1] >= 2.85  # its winding's continuous rating, 3 N, less the margin
    if force > 3.0:
        assert statistics.derated["top"] < 3.6
        assert runner.latest.allocation.status == Status.NEAREST
    else:
        assert runner.latest.allocation.status == Status.EXACT


def test_a_module_too_hot_to_hold_its_cable_taut_is_lost(rehearsal):
    """Its winding bears 0.3 A for good here, 0.9 N, and the rig wants 1.5 N at least."""
    rig = rehearsal.rig
    taut = [tl.Module(each.name, each.anchor, 1.5, 6.0) for each in rig.modules]
    rehearsal = Rehearsal(tl.Rig(rig.name, rig.kind, taut, rig.home), trouble_at=1e9)
    for client in rehearsal.group.clients:
        client.set_parameter("tension_lower", 0.5)
        client.set_parameter("winding_to_housing", 50.0)
        client.set_parameter("housing_to_ambient", 90.0)
        client.set_parameter("winding_capacity", 1.0)
        client.set_parameter("housing_capacity", 1.0)
    with pytest.raises(ModuleFault, match=r"is too hot: it bears 1\.(4\d|50) N, less than its lower"):
        rehearsal.runner(rehearsal.demand(np.zeros(3))).run(300.0)
    rehearsal.trouble_at = rehearsal.world.time
    assert_released(rehearsal)


@dataclass(frozen=True)
class Raises:
    """Solver that fails once `broken` has an entry."""

    broken: list
    policies = ("force",)

    def solve(self, problem):
        if self.broken:
            raise RuntimeError("no idea")
        return tl.solvers.make("newton").solve(problem)


BROKEN = []
NAN = r"demand of cycle 2[56]: wrench is \[0.0, nan, 0.0\]; all of it must be finite"


@pytest.mark.parametrize(
    ("trouble", "error", "said"),
    [
        (lambda: Demand(np.array([0.0, np.nan, 0.0])), HardwareError, NAN),
        (lambda: 1 / 0, ZeroDivisionError, "division by zero"),
        (lambda: BROKEN.append(1), RuntimeError, "no idea"),
    ],
    ids=["NaN from the demand", "a demand that raises", "a solver that raises"],
)
def test_an_error_of_the_demand_or_the_solver_stops_all(rehearsal, trouble, error, said):
    BROKEN.clear()
    runner = rehearsal.runner(rehearsal.demand(trouble=trouble), solver=Raises(BROKEN))
    with pytest.raises(error, match=said) as caught:
        runner.run(2.0)
    assert runner.statistics.ended == f"{error.__name__}: {caught.value}"
    assert_released(rehearsal)


def test_a_sink_that_fails_stops_all_and_the_others_are_closed(rehearsal):
    class Full(EventList):
        def write(self, cycle):
            if rehearsal.trouble_at is not None:
                raise LogError("the disk is full")

    class Other(EventList):
        def close(self, statistics):
            ended.append(statistics.ended)

    ended = []
    with pytest.raises(LogError, match="the disk is full"):
        rehearsal.runner(rehearsal.demand(), sinks=[Full(), Other()]).run(5.0)
    assert ended == ["LogError: the disk is full"]
    assert_released(rehearsal)


class Jumping:
    """A clock that shows a wrong time from some moment on."""

    def __init__(self, clock):
        self.clock, self.off, self.falters = clock, 0.0, lambda: False

    def now(self):
        return self.clock.now() + self.off

    def wait_until(self, when):
        self.clock.wait_until(when - self.off)
        if self.falters():
            self.off = -0.1


def test_a_clock_that_jumps_far_ahead_ends_the_run(rehearsal):
    clock = Jumping(rehearsal.clock)
    runner = rehearsal.runner(rehearsal.demand(trouble=lambda: setattr(clock, "off", 100.0)), clock=clock)
    runner.run(2.0)  # for this clock, the run is over
    assert runner.statistics.missed > 1000
    assert_released(rehearsal)


def test_a_clock_that_jumps_back_or_goes_back_while_it_is_waited_for(rehearsal):
    clock = Jumping(rehearsal.clock)
    runner = rehearsal.runner(rehearsal.demand(trouble=lambda: setattr(clock, "off", -100.0)), clock=clock)
    # Waiting for a time that is far off, the host hangs: modules time out, and say so when it comes back.
    with pytest.raises(HardwareError, match=r"has released its cable \(TIMEOUT\)|the clock went back"):
        runner.run(2.0)
    assert rehearsal.let_pass(0.0) <= TAUT + 1e-6
    rehearsal = Rehearsal(rehearsal.rig)
    clock = Jumping(rehearsal.clock)
    clock.falters = lambda: rehearsal.trouble_at is not None
    with pytest.raises(HardwareError, match=r"the clock went back by 0\.1 s"):
        rehearsal.runner(rehearsal.demand(), clock=clock).run(2.0)
    assert_released(rehearsal)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_programs_stops_all(rehearsal, number):
    statistics = rehearsal.runner(rehearsal.demand(trouble=lambda: signal.raise_signal(number))).run(2.0)
    assert statistics.ended == f"signal {signal.Signals(number).name}"
    assert not statistics.emergency
    assert set(rehearsal.states().values()) == {"IDLE"}
    assert_released(rehearsal)


def test_the_signal_of_the_emergency_stop_is_one(rehearsal):
    statistics = rehearsal.runner(rehearsal.demand(trouble=lambda: signal.raise_signal(ESTOP_SIGNAL))).run(2.0)
    assert (statistics.ended, statistics.emergency) == ("emergency stop (from another terminal)", True)
    assert set(rehearsal.states().values()) == {"ESTOP"}
    assert rehearsal.let_pass(rehearsal.world.time + 1e-3) == 0.0


def test_one_that_is_lost_is_done_without_by_the_others(cube):
    rehearsal, name = cube
    wrench = np.array([1.0, 0.0, 0.0])
    runner = rehearsal.runner(rehearsal.demand(wrench, rehearsal.links[name].cut), on_loss="continue")
    statistics = runner.run(1.0)
    assert list(statistics.lost) == [name]
    assert statistics.ended == "duration reached"
    last = runner.latest
    assert not last.state.active[0]
    assert last.state.active[1:].all()
    # It timed out as its link closed, and keeps its cable taut for 2 s: the others make up for that.
    pulls = np.append(TAUT, last.allocation.tensions[1:])
    np.testing.assert_allclose(last.state.structure @ pulls, wrench, atol=1e-6)
    assert last.allocation.tensions[0] == 0.0
    # Within one cycle: the first one after the cut neither reads nor commands the lost module.
    _, after = [state for state in rehearsal.cycles if state.time >= TROUBLE][:2]
    assert not after.active[0]
    assert rehearsal.module(name).sample.commanded <= TAUT
    rehearsal.let_pass(rehearsal.world.time + 3.0)
    assert not any(module.sample.driver_on for module in rehearsal.world.modules)


@pytest.mark.parametrize("manner", ["cut", "freeze"])
def test_what_a_lost_module_still_pulls_is_made_up_for_until_it_has_let_go(cube, manner):
    """What the cables really exert, while a module times out, keeps its cable taut for 2 s, and lets go of it."""
    rehearsal, name = cube
    wrench, true = np.array([1.5, 0.0, 0.0]), []
    lose = rehearsal.demand(wrench, getattr(rehearsal.links[name], manner))

    def demand(state):
        if rehearsal.trouble_at is not None:
            true.append((rehearsal.world.time - rehearsal.trouble_at, *rehearsal.world.wrench))
        return lose(state)

    rehearsal.runner(demand, on_loss="continue").run(4.0)
    found = np.array(true)
    errors = np.linalg.norm(found[:, 1:] - wrench, axis=1)
    assert errors[found[:, 0] > 0.1].mean() < 0.2  # eight spools, each with 0.05 N of friction
    # What is not known: whether the module ramps a cycle sooner or later, at 60 N/s.
    assert errors.max() < 60.0 * 2 * CYCLE


def test_what_a_silent_module_said_last_is_no_measurement_once_it_is_old(cube, tmp_path):
    """Its tension is unknown before it is lost, and so is the wrench; afterwards it has let go of its cable."""
    rehearsal, name = cube
    log = new_log(tmp_path / "run.mcap", rehearsal.rig)
    published = SharedRun(rehearsal.rig, "newton", RunSettings(), rehearsal.group.clients)
    trouble = rehearsal.links[name].freeze
    runner = rehearsal.runner(rehearsal.demand(trouble=trouble), sinks=[log, published], on_loss="continue")
    statistics = runner.run(2.0)
    run = read_run(tmp_path / "run.mcap")
    unknown = run.ages[:, 0] > 5.0 * CYCLE
    assert (~unknown[run.time < TROUBLE]).all()
    assert unknown[run.time > TROUBLE + 6.0 * CYCLE].all()
    assert (unknown & run.active[:, 0]).any()
    np.testing.assert_array_equal(np.isnan(run.measured[:, 0]), unknown)
    assert np.isfinite(run.measured[:, 1:]).all()
    wrench = measured_wrench(run.structure, run.measured, run.active)
    np.testing.assert_array_equal(np.isnan(wrench).all(axis=1), unknown & run.active[:, 0])
    others = np.einsum("knm,km->kn", run.structure[:, :, 1:], run.measured[:, 1:])
    np.testing.assert_allclose(wrench[~run.active[:, 0]], others[~run.active[:, 0]])
    report = RunSnapshot.unpack(json.loads(published.pack()), rehearsal.rig)
    assert [each is None for each in report.telemetry] == [True, *[False] * 7]
    assert statistics.late_telemetry[name] <= TTL / CYCLE, "it is late until it is lost"


def test_when_all_are_lost_there_is_nothing_to_go_on_with(rehearsal):
    def cut():
        for link in rehearsal.links.values():
            link.cut()

    with pytest.raises(HardwareError, match="no module is left"):
        rehearsal.runner(rehearsal.demand(GENTLE, cut), on_loss="continue").run(2.0)
    assert_released(rehearsal)
