"""Clocks of a run."""

from pathlib import Path

import pytest

from tensionlab.hardware.runner.settings import RealClock, WorldClock
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig

RIG = load_rig(Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml")


def test_simulated_modules_run_while_the_computers_clock_is_waited_for(simulated_time):
    world = World(RIG)
    group = world.group()
    clock, before = RealClock(group.clients), world.modules[0].seconds
    for client in group.clients:
        client.telemetry_every(5)
    start = clock.now()
    clock.wait_until(start + 0.25)
    assert clock.now() == pytest.approx(start + 0.25)
    for client, module in zip(group.clients, world.modules, strict=True):
        assert module.seconds - before == pytest.approx(0.25, abs=1e-3)
        assert client.link.clock() - client.telemetry.time < 0.01
    clock.wait_until(start)  # it has been
    assert clock.now() == pytest.approx(start + 0.25)
    assert world.modules[0].seconds - before == pytest.approx(0.25, abs=1e-3)


def test_a_paced_world_is_as_late_as_its_computer(simulated_time):
    world = World(RIG)
    clock = WorldClock(world, paced=True)
    clock.wait_until(0.1)
    assert world.time == pytest.approx(0.1)
    simulated_time.sleep(0.4)  # a cycle that takes so long
    assert world.time == pytest.approx(0.1)
    assert clock.now() == pytest.approx(0.5)
    clock.wait_until(0.2)
    assert world.time == pytest.approx(0.5)
