"""Settings, and clocks on a computer whose time the test lets pass."""

import numpy as np
import pytest

from tensionlab.demand import Demand
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner import settings
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RealClock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import World
from tests.helpers.runs import four


class Computer:
    """Time of a computer, which passes in sleep, and where the test says so."""

    now = 1000.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds + 1e-6  # or a little longer


@pytest.fixture
def computer(monkeypatch):
    monkeypatch.setattr(settings, "time", computer := Computer())
    return computer


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rate": 5.0}, "rate is from 8 Hz, which is 2 set-points in a ttl of 0.25 s, to 10000 Hz; got 5"),
        ({"rate": float("nan")}, "rate is from"),
        ({"ttl": 0.01}, "ttl is from 0.05 to 2 s; got 0.01"),
        ({"on_loss": "hope"}, "on_loss is 'hope'; give one of stop, continue"),
        ({"processor": 100_000}, r"this process may use the processors \d.*; got 100000"),
    ],
)
def test_settings_that_cannot_work(values, message):
    with pytest.raises(HardwareError, match=message):
        RunSettings(**values)


def test_the_real_clock_waits_until_then_and_no_longer(computer):
    clock = RealClock()
    for when in (1000.5, 1000.2):
        clock.wait_until(when)
        assert clock.now() == pytest.approx(1000.5, abs=1e-4)


def test_a_paced_world_keeps_to_real_time_in_the_shortest_steps_too(computer):
    clock = WorldClock(World(four()), paced=True)
    for step in range(1, 501):
        clock.wait_until(2e-4 * step)
    assert computer.now == pytest.approx(1000.1, abs=1e-3)


def test_a_paced_world_is_never_ahead_of_real_time_and_leaves_no_cycle_out_behind_it(computer):
    world, times = World(four()), []

    def demand(state):
        times.append(computer.now)
        computer.now += 1.0 if state.cycle in (10, 20) else 0.0  # whatever holds the process up
        return Demand(np.zeros(3))

    clock = WorldClock(world, paced=True)
    statistics = Runner(four(), world.group(), "newton", demand, RunSettings(), clock=clock).run(1.0)
    assert (statistics.cycles, statistics.missed, statistics.lost) == (50, 0, {})
    assert max(statistics.start_delays) == pytest.approx(0.0, abs=1e-6)
    steps = np.diff(times)
    assert steps[[10, 20]] == pytest.approx([1.0, 1.0], abs=1e-3)
    assert np.delete(steps, [10, 20]) == pytest.approx(0.02, abs=1e-3)  # what was lost is not caught up
