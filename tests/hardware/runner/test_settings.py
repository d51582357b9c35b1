"""The clock of simulated modules that keep to real time, on a computer whose time the test lets pass."""

import numpy as np
import pytest

from tensionlab.demand import Demand
from tensionlab.errors import ModuleFault
from tensionlab.hardware.runner import settings
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import MAX_BEHIND_S, PlaybackClock, RealClock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import World
from tests.helpers.runs import four


class Computer:
    """Time of a computer, which passes in sleep, and where the test says so."""

    def __init__(self):
        self.now, self.worked = 1000.0, 10.0

    def perf_counter(self):
        return self.now

    def process_time(self):
        return self.worked

    def sleep(self, seconds):
        self.now += seconds + 1e-6  # or a little longer


@pytest.fixture
def computer(monkeypatch):
    monkeypatch.setattr(settings, "time", computer := Computer())
    return computer


def test_a_paced_world_keeps_to_real_time(computer):
    world = World(four())
    clock = WorldClock(world, paced=True)
    clock.wait_until(0.5)
    computer.now += 0.05
    assert clock.now() == pytest.approx(0.55, abs=1e-4)
    clock.wait_until(0.6)
    assert world.time == pytest.approx(0.6, abs=1e-4)
    assert computer.now == pytest.approx(1000.6, abs=1e-4)
    computer.now += 1.0
    assert clock.now() == pytest.approx(0.6 + MAX_BEHIND_S, abs=1e-4)


def test_the_real_clock_waits_until_then_and_no_longer(computer):
    clock = RealClock()
    clock.wait_until(1000.5)
    assert clock.now() == pytest.approx(1000.5, abs=1e-4)
    clock.wait_until(1000.2)
    assert clock.now() == pytest.approx(1000.5, abs=1e-4)


def test_time_that_the_computer_lost_does_not_pass(computer):
    clock = WorldClock(World(four()), paced=True)
    computer.now += 3.0
    assert clock.now() == pytest.approx(settings.MAX_BEHIND_S)


def ran(computer, work):
    """Run for 3 s; two of the cycles take 1 s, in which this process computes for a time."""
    world = World(four())
    clock = WorldClock(world, paced=True)
    clock.real_time = False  # a watchdog would go by the real computer

    def demand(state):
        if state.cycle in (10, 20):
            computer.now += 1.0
            computer.worked += work
        return Demand(np.zeros(3))

    return Runner(four(), world.group(), "newton", demand, RunSettings(), clock=clock).run(3.0)


def test_a_process_that_gets_no_time_loses_none_of_its_simulated_modules(computer):
    statistics = ran(computer, 0.01)
    assert statistics.ended == "duration reached"
    assert not statistics.lost
    assert statistics.missed > 0


def test_one_that_computes_for_too_long_loses_them(computer):
    with pytest.raises(ModuleFault, match=r"TIMEOUT.*this computer took 1\.02 s from one cycle to the next"):
        ran(computer, 1.0)


def test_playback_keeps_to_real_time_in_the_shortest_steps_too(computer):
    clock = PlaybackClock(World(four()))
    for step in range(1, 501):
        clock.wait_until(2e-4 * step)
    assert computer.now == pytest.approx(1000.1, abs=1e-3)


def test_playback_is_never_ahead_of_real_time_and_leaves_no_cycle_out_behind_it(computer):
    world, times = World(four()), []

    def demand(state):
        times.append(computer.now)
        computer.now += 1.0 if state.cycle in (10, 20) else 0.0  # whatever holds the process up
        return Demand(np.zeros(3))

    clock = PlaybackClock(world)
    statistics = Runner(four(), world.group(), "newton", demand, RunSettings(), clock=clock).run(1.0)
    assert (statistics.cycles, statistics.missed, statistics.lost) == (50, 0, {})
    assert max(statistics.start_delays) == pytest.approx(0.0, abs=1e-6)
    steps = np.diff(times)
    assert steps[[10, 20]] == pytest.approx([1.0, 1.0], abs=1e-3)
    assert np.delete(steps, [10, 20]) == pytest.approx(0.02, abs=1e-3)  # what was lost is not caught up
